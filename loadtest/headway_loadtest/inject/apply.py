"""Injection into drives: from offsets along the road to the readings on the wire."""

import zlib
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from headway_loadtest.inject.consistent import inject_consistent
from headway_loadtest.inject.faults import Injected, Kind, Sensor, Spec, inject
from headway_loadtest.sources.drive import F64, Drive
from headway_loadtest.sources.road import Road

SPEED_MAX_MPS = 163.8
SILENCE_S = 0.7


@dataclass(frozen=True, slots=True)
class Label:
    """The truth about one event: vehicle, sensor, kind and time (event time, inclusive).

    A miss runs from the last reading before it to the first one after.
    """

    vehicle: str
    sensor: Sensor
    kind: Kind
    start_us: int
    stop_us: int


def corrupt(drive: Drive, seed: int, spec: Spec | None) -> tuple[Drive, tuple[Label, ...]]:
    """Return the drive with injected faults, and its labels; readings that are never sent are left out.

    Chance depends only on the seed and the vehicle's name, so a vehicle has the same faults in any company. A silence
    of the recording itself is labelled as a miss.
    """
    rng = np.random.default_rng((seed, zlib.crc32(drive.vehicle.encode())))
    if spec is None or rng.random() >= spec.share:
        return drive, _silences(drive)
    x_m, v_mps = drive.x_m, drive.speed_mps
    present = np.ones(len(x_m), np.bool_)
    events: list[Injected] = []
    for kinds, injector in (
        (tuple(kind for kind in spec.kinds if kind.is_consistent), inject_consistent),
        (tuple(kind for kind in spec.kinds if not kind.is_consistent), inject),
    ):
        if kinds:
            corrupted = injector(rng, x_m, v_mps, replace(spec, kinds=kinds))
            x_m, v_mps, present = corrupted.x_m, corrupted.v_mps, corrupted.present
            events.extend(corrupted.events)
    labels = [label for event in events if (label := _label(drive, event)) is not None]
    return _without(_moved(drive, x_m, v_mps), present), (*labels, *_silences(drive))


def sendable_speed(true_mps: F64, reported_mps: F64) -> F64:
    """Return speeds that a message can carry: an offset to below 0 changes its sign."""
    return np.minimum(np.where(reported_mps < 0.0, 2 * true_mps - reported_mps, reported_mps), SPEED_MAX_MPS)


def _moved(drive: Drive, x_m: F64, v_mps: F64) -> Drive:
    """Return the drive at other places along its own road, and at other speeds."""
    road = Road.driven(drive.x_m, drive.lat, drive.lon, drive.heading_deg)
    false, true = road.at(x_m), road.at(drive.x_m)
    lat, lon, heading_deg = (
        reading + (there - here)
        for reading, there, here in zip((drive.lat, drive.lon, drive.heading_deg), false, true, strict=True)
    )
    return replace(
        drive,
        x_m=x_m,
        speed_mps=sendable_speed(drive.speed_mps, v_mps),
        lat=lat,
        lon=lon,
        heading_deg=heading_deg % 360.0,
    )


def _without(drive: Drive, present: NDArray[np.bool_]) -> Drive:
    if present.all():
        return drive
    columns = {name: getattr(drive, name)[present] for name in ("t_s", "x_m", "speed_mps", "lat", "lon", "heading_deg")}
    ahead = drive.ahead
    if ahead is not None:
        columns["ahead"] = replace(
            ahead,
            which=ahead.which[present],
            range_m=ahead.range_m[present],
            range_rate_mps=ahead.range_rate_mps[present],
        )
    return replace(drive, **columns)


def _label(drive: Drive, event: Injected) -> Label | None:
    """Return the label of an event; None for a silence at either end, which is no different from absence."""
    t_us = np.round(drive.t_s * 1e6).astype(np.int64)
    first, last = event.start, event.stop - 1
    if event.kind is Kind.MISS:
        first, last = first - 1, last + 1
        if first < 0 or last == len(t_us):
            return None
    return Label(drive.vehicle, event.sensor, event.kind, int(t_us[first]), int(t_us[last]))


def _silences(drive: Drive) -> tuple[Label, ...]:
    before = np.flatnonzero(np.diff(drive.t_s) > SILENCE_S)
    t_us = np.round(drive.t_s * 1e6).astype(np.int64)
    return tuple(Label(drive.vehicle, Sensor.LINK, Kind.MISS, int(t_us[i]), int(t_us[i + 1])) for i in before.tolist())
