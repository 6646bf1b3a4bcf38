"""Frames of a SUMO scenario that is stepped while its vehicles are sent: of each vehicle ten messages a second.

Faults of a sensor are drawn for a vehicle when it enters, for as long as the replay may last.
"""

import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from headway_loadtest.inject.apply import Label, sendable_speed
from headway_loadtest.inject.faults import Corrupted, Kind, Spec, inject
from headway_loadtest.sources.drive import F64, SourceError
from headway_loadtest.sources.road import displace
from headway_loadtest.sources.sumo import PREFIX, coupled
from headway_loadtest.traffic.frames import MSG_CNT_MASK, Frame, Vehicle

MESSAGE_S: Final = 0.1
ORIGIN: Final = (48.0, 11.0)
"""Place of x = y = 0 in a network without a projection, degrees."""
_X_Y, _SPEED, _ANGLE = 0x42, 0x40, 0x43
"""Variables of TraCI: position, speed and heading of a vehicle."""


@dataclass(slots=True)
class _Driving:
    """A vehicle on the road."""

    row: int
    entered: int
    """Message number of the replay at which it entered."""
    faults: Corrupted | None
    sent: int = 0
    number: int = 0
    """Of its newest message within the replay."""


class SumoFrames:
    """Frames of one scenario, for so many seconds; they can be played once.

    Parameters
    ----------
    name
        Makes an identifier of the bus from SUMO's name of a vehicle.
    inject
        Faults, of sensor kinds.

    Raises
    ------
    SourceError
        The injection needs whole drives; while it is played, what SUMO refuses.
    """

    def __init__(
        self, config: Path, seconds: float, name: Callable[[str], str], *, seed: int = 0, inject: Spec | None = None
    ) -> None:
        if inject is not None and any(kind.is_consistent for kind in inject.kinds):
            raise SourceError(
                f"{PREFIX}{config}: kinds that keep location and speed consistent need whole drives:"
                " write floating car data with SUMO, and replay the file"
            )
        self.labels: list[Label] = []
        self._config = config
        self._seconds = seconds
        self._name = name
        self._seed = seed
        self._inject = inject

    def __iter__(self) -> Iterator[Frame]:
        with coupled(self._config, self._seed) as sumo:
            step_s = sumo.simulation.getDeltaT()
            steps = max(1, round(MESSAGE_S / step_s))
            total = int(self._seconds / (steps * step_s))
            driving: dict[str, _Driving] = {}
            entered = 0
            for number in range(total):
                sumo.simulationStep(sumo.simulation.getTime() + steps * step_s)
                for vehicle in sumo.simulation.getDepartedIDList():
                    sumo.vehicle.subscribe(vehicle, (_X_Y, _SPEED, _ANGLE))
                seen = sumo.vehicle.getAllSubscriptionResults()
                entering = []
                for vehicle in [one for one in seen if one not in driving]:
                    length_m = sumo.vehicle.getLength(vehicle)
                    entering.append(Vehicle(entered, self._name(vehicle), length_m))
                    driving[vehicle] = _Driving(entered, number, self._faults(vehicle, total - number))
                    entered += 1
                for vehicle in [one for one in driving if one not in seen]:
                    self._label(vehicle, driving.pop(vehicle), steps * step_s)
                if seen:
                    yield self._frame(sumo, tuple(entering), seen, driving, (number, steps * step_s))
                elif not sumo.simulation.getMinExpectedNumber():
                    break
            for vehicle, one in driving.items():
                self._label(vehicle, one, steps * step_s)

    def _faults(self, vehicle: str, messages: int) -> Corrupted | None:
        """Draw the faults of a vehicle, as offsets; chance depends on the seed and its name."""
        rng = np.random.default_rng((self._seed, zlib.crc32(vehicle.encode())))
        if self._inject is None or rng.random() >= self._inject.share:
            return None
        truth = np.zeros(messages)
        return inject(rng, truth, truth, self._inject)

    def _label(self, vehicle: str, one: _Driving, every_s: float) -> None:
        """Add what was injected while a vehicle was on the road."""
        if one.faults is None:
            return
        end = one.number + 1 - one.entered
        for event in one.faults.events:
            start, stop = event.start, min(event.stop, end)
            is_absence = event.kind is Kind.MISS and (start == 0 or event.stop >= end)
            if start < end and not is_absence:
                first = one.entered + start - (event.kind is Kind.MISS)
                last = one.entered + stop - (event.kind is not Kind.MISS)
                times_us = (round(number * every_s * 1e6) for number in (first, last))
                self.labels.append(Label(self._name(vehicle), event.sensor, event.kind, *times_us))

    def _frame(
        self,
        sumo: Any,  # noqa: ANN401 - of a package without types
        entering: tuple[Vehicle, ...],
        seen: dict[str, dict[int, Any]],
        driving: dict[str, _Driving],
        at: tuple[int, float],
    ) -> Frame:
        number, every_s = at
        vehicles = [driving[name] for name in seen]
        x_m, y_m = np.array([one[_X_Y] for one in seen.values()], float).T
        speed_mps = np.array([one[_SPEED] for one in seen.values()], float)
        heading_deg = np.array([one[_ANGLE] for one in seen.values()], float) % 360.0
        lat, lon = _places(sumo, x_m, y_m)
        offsets = np.zeros((2, len(seen)))
        present = np.ones(len(seen), np.bool_)
        for i, one in enumerate(vehicles):
            one.number = number
            if one.faults is not None:
                since = number - one.entered
                offsets[:, i] = one.faults.x_m[since], one.faults.v_mps[since]
                present[i] = one.faults.present[since]
        lat, lon = displace(lat, lon, heading_deg, offsets[0])
        counts = np.array([one.sent & MSG_CNT_MASK for one in vehicles])
        for one, sends in zip(vehicles, present.tolist(), strict=True):
            one.sent += sends
        return Frame(
            entering=entering,
            t_us=np.full(int(present.sum()), round(number * every_s * 1e6)),
            row=np.array([one.row for one in vehicles])[present],
            msg_cnt=counts[present],
            lat=lat[present],
            lon=lon[present],
            speed_mps=sendable_speed(speed_mps, speed_mps + offsets[1])[present],
            heading_deg=heading_deg[present],
        )


def _places(sumo: Any, x_m: F64, y_m: F64) -> tuple[F64, F64]:  # noqa: ANN401 - of a package without types
    """Return latitudes and longitudes: by the projection of the network, else on a plane at `ORIGIN`."""
    east, north = sumo.simulation.convertGeo(0.0, 0.0)
    if (east, north) != (0.0, 0.0):
        lon, lat = np.array([sumo.simulation.convertGeo(*place) for place in zip(x_m, y_m, strict=True)]).T
        return lat, lon
    origin_lat, origin_lon = (np.full(x_m.size, degrees) for degrees in ORIGIN)
    lat, _ = displace(origin_lat, origin_lon, np.zeros(x_m.size), y_m)
    _, lon = displace(lat, origin_lon, np.full(x_m.size, 90.0), x_m)
    return lat, lon
