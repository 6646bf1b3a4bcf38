"""The deviation that an event states is the largest between the readings and the estimates while it is open.

The oracle knows where the cars are told to be: they drive due north, so the place of a reading is its latitude.
"""

import random
from itertools import groupby

import numpy as np
import pytest
from made_recording import BEGIN, Fault, northbound

from headway import Detector
from headway_schemas import Event, Sensor

FAULTS: dict[str, Fault] = {
    "6 m back": lambda _s, _rng: (-6.0, 0.0),
    "1 m back": lambda _s, _rng: (-1.0, 0.0),
    "0.3 m/s away": lambda s, _rng: (0.3 * s, 0.0),
    "2 m/s too fast": lambda _s, _rng: (0.0, 2.0),
    "scatter of 1 m": lambda _s, rng: (rng.gauss(0.0, 1.0), 0.0),
    "one in ten 8 m off": lambda _s, rng: (8.0 if rng.random() < 0.1 else 0.0, 0.0),
}


def quoted(updates: list[Event]) -> tuple[float, float]:
    """Return what the page and the notices state of an event."""
    known = [update.deviation for update in updates if update.deviation is not None]
    return max(one.x_m or 0.0 for one in known), max(one.v_mps or 0.0 for one in known)


@pytest.mark.parametrize("fault", FAULTS.values(), ids=FAULTS)
@pytest.mark.parametrize("seed", [1, 2])
def test_it_is_within_a_twentieth(fault: Fault, seed: int) -> None:
    records, north_m = northbound(fault, random.Random(seed))
    detector = Detector()
    result = detector.process(records)
    events = sorted([*result.events, *detector.finish().events], key=lambda event: event.event_id)
    t_us = np.array([record["t_us"] for record in records])
    is_blue = np.array([record["id"] == "blue" for record in records])
    estimate_m, estimate_mps = (np.array(result.verdicts[name], dtype=float) for name in ("x_m", "v_mps"))
    before = is_blue & (np.arange(len(records)) // 2 > BEGIN - 100) & (np.arange(len(records)) // 2 < BEGIN - 5)
    apart_m = np.abs(north_m - estimate_m - np.median((north_m - estimate_m)[before]))
    apart_mps = np.abs(np.array([record["speed_mps"] for record in records]) - estimate_mps)
    compared = 0
    for _, group in groupby(events, key=lambda event: event.event_id):
        updates = list(group)
        last = max(updates, key=lambda update: update.detected_us)
        if last.suspect != "blue" or last.sensor is Sensor.LINK:
            continue
        while_open = is_blue & (t_us >= (updates[0].onset_us or updates[0].t_us)) & (t_us <= last.t_us)
        x_m, v_mps = quoted(updates)
        if last.sensor is not Sensor.SPEED:
            assert x_m == pytest.approx(apart_m[while_open].max(), rel=0.05)
        if last.sensor is not Sensor.LOCATION:
            assert v_mps == pytest.approx(apart_mps[while_open].max(), rel=0.05)
        compared += 1
    assert compared > 0
