"""Vehicles from site to site: a vehicle that enters the area of a neighbour goes over with its filter and open event.

A site sends the state of a vehicle once, when its position enters the area of a neighbour. From then on the vehicle is
judged here for its neighbours only, and the other site publishes it. The receiver takes a state up with the vehicle's
next message. The key of the checksum is derived from a common secret, the origin and the receiver, so a state from
elsewhere, or for another site, is refused. So is one that is older than what the receiver knows.
"""

import hashlib
import tomllib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from headway.core.engine import Engine
from headway.core.types.batch import Batch
from headway.core.types.config import DetectorConfig
from headway.core.types.vehicle_state import VehicleState
from headway.edge.codec.vehicle_state import Refusal, VehicleStateCodec
from headway.edge.identity import Identity
from headway.errors import UserError, first_problem

_WAITS_US: Final = 10_000_000
"""A state waits so long for the next message of its vehicle, and a vehicle is sent again after so long."""
_FRESH_US: Final = 2_000_000
"""Event time from a state to the next message of its vehicle here, at most: an older state is a repetition."""
_WAITING_MAX: Final = 10_000
_SWEEP_US: Final = 1_000_000
UNKNOWN_ORIGIN: Final = "unknown_origin"
LATE: Final = "late"
SENT: Final = "sent"
ADOPTED: Final = "adopted"
RESULTS: Final = (SENT, ADOPTED, UNKNOWN_ORIGIN, LATE, *(refusal.value for refusal in Refusal))


class Area(BaseModel):
    """Where a neighbour takes over: a rectangle, in degrees."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    south: float = Field(ge=-90, le=90)
    west: float = Field(ge=-180, le=180)
    north: float = Field(ge=-90, le=90)
    east: float = Field(ge=-180, le=180)


class HandoverConfig(BaseModel):
    """The file of a site: the secret that it shares with its neighbours, and the area of each."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    secret: str = Field(min_length=16)
    neighbours: dict[str, Area]


def read_config(file: Path) -> HandoverConfig:
    """Read the file of a site.

    Raises
    ------
    UserError
        It cannot be read, or is wrong. The secret is not told.
    """
    try:
        return HandoverConfig.model_validate(tomllib.loads(file.read_text(encoding="utf-8")))
    except ValidationError as error:
        raise UserError(f"handover {file}: {first_problem(error)}") from None
    except (OSError, ValueError) as error:
        raise UserError(f"handover {file}: {error}") from None


@dataclass(slots=True)
class _Neighbour:
    area: Area
    outgoing: VehicleStateCodec
    incoming: VehicleStateCodec
    sent: dict[bytes, int] = field(default_factory=dict)
    """Receive time of the newest message of each vehicle that is there."""

    def contains(self, batch: Batch) -> NDArray[np.bool_]:
        area, lat, lon = self.area, batch.lat_deg, batch.lon_deg
        inside: NDArray[np.bool_] = (lat >= area.south) & (lat < area.north) & (lon >= area.west) & (lon < area.east)
        return inside


@dataclass(frozen=True, slots=True)
class Handed:
    """What goes out with one batch."""

    owned: NDArray[np.bool_]
    """(B,) whether this site publishes the vehicle of each record."""
    states: Sequence[tuple[str, str, bytes]]
    """Site, vehicle and state to send."""
    event_ids: Sequence[str]
    """Open events that go with them."""


class Handover:
    """Sends and takes up vehicles of one site, before each step of its engine."""

    def __init__(self, config: HandoverConfig, detector: DetectorConfig, identity: Identity, engine: Engine) -> None:
        def codec(origin: str, to: str) -> VehicleStateCodec:
            key = hashlib.blake2b(f"{origin} {to}".encode(), key=config.secret.encode()[:64]).digest()
            return VehicleStateCodec(detector, identity.parameters, key)

        site = identity.site
        self._neighbours = {
            name: _Neighbour(area, codec(site, name), codec(name, site)) for name, area in config.neighbours.items()
        }
        self.engine = engine
        self._waiting: dict[bytes, tuple[VehicleState, int]] = {}
        self._swept_us = 0
        self.results: Counter[str] = Counter()
        """States by what became of them: one of `RESULTS`."""

    def receive(self, origin: str, payload: bytes, now_us: int, clock_offset_us: int) -> None:
        """Keep a state for the next message of its vehicle, or count why it is refused; times are local."""
        neighbour = self._neighbours.get(origin)
        if neighbour is None:
            self.results[UNKNOWN_ORIGIN] += 1
            return
        state = neighbour.incoming.decode(payload, clock_offset_us)
        if isinstance(state, Refusal):
            self.results[state.value] += 1
        elif now_us - int(state.tables["tracks"]["received_us"][0]) > _WAITS_US or len(self._waiting) >= _WAITING_MAX:
            self.results[LATE] += 1
        else:
            self._waiting[state.vehicle.encode()] = state, now_us

    def before_step(self, batch: Batch, now_us: int, clock_offset_us: int) -> Handed:
        """Take up the states of vehicles in this batch, and release those that entered the area of a neighbour."""
        self._take_up(batch)
        owned, states, event_ids = np.ones(len(batch), np.bool_), [], list[str]()
        for name, neighbour in self._neighbours.items():
            inside = neighbour.contains(batch)
            owned &= ~inside
            if neighbour.sent:
                for vehicle in set(batch.ids[~inside].tolist()) & neighbour.sent.keys():
                    del neighbour.sent[vehicle]
            for vehicle in dict.fromkeys(batch.ids[inside].tolist()):
                state = None if vehicle in neighbour.sent else self.engine.release(vehicle.decode())
                neighbour.sent[vehicle] = now_us
                if state is not None:
                    states.append((name, state.vehicle, neighbour.outgoing.encode(state, clock_offset_us)))
                    opened = (state.event, state.pair_event, state.miss)
                    event_ids += [event.event_id for event in opened if event is not None]
        self.results[SENT] += len(states)
        if now_us - self._swept_us > _SWEEP_US:
            self._sweep(now_us)
        return Handed(owned, states, event_ids)

    def _take_up(self, batch: Batch) -> None:
        """Adopt the vehicles of this batch that wait, unless they were received here since."""
        for vehicle in set(batch.ids.tolist()) & self._waiting.keys() if self._waiting else ():
            state, _ = self._waiting.pop(vehicle)
            first_us = int(batch.t_us[np.flatnonzero(batch.ids == vehicle)[0]])
            is_fresh = 0 < first_us - int(state.tables["tracks"]["t_us"][0]) < _FRESH_US
            self.results[ADOPTED if is_fresh and self.engine.adopt(state) else LATE] += 1

    def _sweep(self, now_us: int) -> None:
        """Forget what is older than `_WAITS_US`."""
        self._swept_us = now_us
        self.results[LATE] += len(self._waiting)
        self._waiting = {name: of for name, of in self._waiting.items() if now_us - of[1] <= _WAITS_US}
        self.results[LATE] -= len(self._waiting)
        for neighbour in self._neighbours.values():
            neighbour.sent = {name: at for name, at in neighbour.sent.items() if now_us - at <= _WAITS_US}


def results(handover: Handover | None) -> Mapping[str, int]:
    """Return the count of each result."""
    return {result: handover.results[result] if handover is not None else 0 for result in RESULTS}
