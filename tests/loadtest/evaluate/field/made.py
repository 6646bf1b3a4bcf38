"""Recordings, alarms and faults made by hand."""

import numpy as np

from headway_loadtest.evaluate.field.detection import Alarm, Detection, EventUpdate
from headway_loadtest.evaluate.field.faults import Fault
from headway_loadtest.evaluate.field.recordings import T0_US, Recording, empty, move
from headway_loadtest.inject.faults import Kind, Sensor

S = 1_000_000


def driving(seconds=60.0, mps=10.0, gap_after_s=None, vehicles=("a",)):
    """Cars at constant speed, one behind the other, at 10 Hz; a gap of 3 s where asked for."""
    tracks = []
    for which in range(len(vehicles)):
        t_s = np.arange(0.0, seconds, 0.1)
        if gap_after_s is not None:
            t_s = t_s[(t_s <= gap_after_s) | (t_s >= gap_after_s + 3.0)]
        track = empty(t_s.size)
        track["vehicle"] = which
        track["t_us"] = track["received_us"] = T0_US + np.round(t_s * S).astype(np.int64)
        track["lat_deg"], track["lon_deg"], track["heading_deg"], track["speed_mps"] = 45.0, 9.0, 0.0, mps
        move(track, mps * t_s)
        tracks.append(track)
    return Recording(group="set", name="made", vehicles=vehicles, messages=np.concatenate(tracks))


def alarm(start_s, cleared_s, kind="bias", sensor="speed", suspect="a", observations=()):
    updates = [EventUpdate(T0_US + round(start_s * S), kind, sensor, suspect, True, observations)]
    if cleared_s is not None:
        updates.append(EventUpdate(T0_US + round(cleared_s * S), kind, sensor, suspect, False))
    return Alarm(f"{suspect}-{start_s}", suspect, None, updates)


def detection(*alarms, pair_hours=0.0):
    return Detection(alarms, pair_hours, T0_US + 60 * S)


def fault(start_s, stop_s, kind=Kind.BIAS, sensor=Sensor.SPEED, vehicle="a"):
    return Fault(vehicle, sensor, kind, T0_US + round(start_s * S), T0_US + round(stop_s * S))
