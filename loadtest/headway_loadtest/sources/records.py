"""Recorded messages as scenes: the records of one drive, as they are, a vehicle for each sender in it."""

from array import array
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from headway_loadtest.sources.drive import F64, Drive, Scene

DRIVES_AT_ONCE: Final = 16
"""Drives whose records may alternate in a recording."""
_COLUMNS: Final = ("t_us", "lat", "lon", "speed_mps", "heading_deg")

Rows = Iterable[tuple[str, Mapping[str, Any]]]
"""Records of BSM v1 with the name of their drive."""


@dataclass(slots=True)
class _Vehicle:
    columns: dict[str, "array[float]"] = field(default_factory=lambda: {name: array("d") for name in _COLUMNS})
    length_m: float | None = None

    def add(self, record: Mapping[str, Any]) -> None:
        for name, column in self.columns.items():
            value = record.get(name)
            column.append(np.nan if value is None else value)
        self.length_m = record.get("length_m", self.length_m)


@dataclass(frozen=True, slots=True)
class RecordedDrives:
    """Scenes of recorded messages; each iteration reads them again. A drive is held in memory while it is read."""

    rows: Callable[[], Rows]

    def __iter__(self) -> Iterator[Scene]:
        drives: OrderedDict[str, dict[str, _Vehicle]] = OrderedDict()
        for name, record in self.rows():
            if name not in drives and len(drives) == DRIVES_AT_ONCE:
                yield _scene(drives.popitem(last=False)[1])
            drives.setdefault(name, {}).setdefault(record["id"], _Vehicle()).add(record)
            drives.move_to_end(name)
        yield from map(_scene, drives.values())


def _scene(vehicles: Mapping[str, _Vehicle]) -> Scene:
    start_us = min(min(vehicle.columns["t_us"]) for vehicle in vehicles.values())
    return tuple(_drive(name, vehicle, start_us) for name, vehicle in vehicles.items())


def _drive(name: str, vehicle: _Vehicle, start_us: float) -> Drive:
    """Return the readings in the order of event time, the first of several at one time."""
    _, order = np.unique(np.asarray(vehicle.columns["t_us"]), return_index=True)
    columns: dict[str, F64] = {column: np.asarray(values)[order] for column, values in vehicle.columns.items()}
    t_s, speed_mps = (columns["t_us"] - start_us) / 1e6, columns["speed_mps"]
    steps_m = np.diff(t_s) * (speed_mps[1:] + speed_mps[:-1]) / 2
    return Drive(
        vehicle=name,
        t_s=t_s,
        x_m=np.concatenate([[0.0], np.cumsum(steps_m)]),
        speed_mps=speed_mps,
        lat=columns["lat"],
        lon=columns["lon"],
        heading_deg=columns["heading_deg"],
        length_m=vehicle.length_m,
    )
