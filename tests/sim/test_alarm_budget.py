"""The operator's alarm budget holds on streamed traffic without a fault, from the first seconds of each vehicle."""

import numpy as np
import pytest
from loadtest.sources.spmd_sample import write_sample

from headway.core.engine import Engine
from headway.core.types.batch import Batch
from headway.core.types.config import DetectorConfig
from headway.core.types.identifiers import id_column
from headway.core.types.records import Kind as EventKind
from headway.core.types.step_result import Phase
from headway_loadtest.inject.faults import Kind, Spec
from headway_loadtest.sources import parse_sources
from headway_loadtest.traffic.fleet import FleetFrames
from headway_loadtest.traffic.frames import Frame, SceneFrames

START_US = 1_700_000_000_000_000
LATENCY_US = 2_000


class Roadside:
    """A service's core at the roadside, and the onsets it published, as (suspect, t_us since the start)."""

    def __init__(self) -> None:
        self._engine = Engine(DetectorConfig(vehicle_capacity=1_000))
        self._ids: dict[int, tuple[str, float]] = {}
        self._since_us: dict[str, tuple[int, int]] = {}
        self.onsets: list[tuple[str, int]] = []

    def take(self, frame: Frame) -> None:
        """Judge the messages of a frame."""
        self._ids.update({row: (name, length_m or np.nan) for row, name, length_m in frame.entering})
        if not len(frame):
            return
        ids = [self._ids[row][0] for row in frame.row.tolist()]
        for name, t_us in zip(ids, frame.t_us.tolist(), strict=True):
            self._since_us[name] = (self._since_us.get(name, (t_us, 0))[0], t_us)
        nothing = np.full(len(frame), np.nan)
        ahead = [record or (None, np.nan, np.nan) for record in frame.leader or [None] * len(frame)]
        t_us = START_US + frame.t_us
        batch = Batch(
            ids=id_column(ids),
            leader_ids=id_column([record[0] for record in ahead]),
            msg_cnt=frame.msg_cnt,
            t_us=t_us,
            received_us=t_us + LATENCY_US,
            lat_deg=frame.lat,
            lon_deg=frame.lon,
            speed_mps=frame.speed_mps,
            heading_deg=frame.heading_deg,
            accel_mps2=nothing,
            accuracy_m=nothing,
            length_m=np.array([self._ids[row][1] for row in frame.row.tolist()]),
            range_m=np.array([record[1] for record in ahead]),
            range_rate_mps=np.array([record[2] for record in ahead]),
        )
        published = self._engine.step(batch, int(t_us[-1]) + LATENCY_US).events
        self.onsets += [
            (e.suspect, e.t_us - START_US) for e in published if e.phase is Phase.ONSET and e.kind is not EventKind.MISS
        ]

    @property
    def vehicle_hours(self) -> float:
        """The time over which all vehicles sent."""
        return sum(last - first for first, last in self._since_us.values()) / 3.6e9


@pytest.mark.parametrize("seed", [0, 1])
def test_a_fleet_of_strangers_keeps_the_budget(seed: int) -> None:
    """Measured .5 an hour (55 h): 2 expected here, 6 exceeded by chance in 1 run of 200."""
    received = Roadside()
    for frame in FleetFrames(300, 50.0, seed=seed):
        received.take(frame)
    assert received.vehicle_hours == pytest.approx(4.2, abs=0.1)
    assert len(received.onsets) <= 6


def test_recorded_drives_stay_near_the_budget(tmp_path) -> None:
    """Smoothed locations, leaders seen by radar: measured 1.8 an hour (37 h), 8 exceeded by chance in 1 run of 70."""
    write_sample(tmp_path, pairs=60, seconds=60.0, seed=4)
    received = Roadside()
    for frame in SceneFrames(parse_sources([str(tmp_path)], seconds=60.0, seed=4), concurrent=1_000):
        received.take(frame)
    assert received.vehicle_hours == pytest.approx(2.0, abs=0.05)
    assert len(received.onsets) <= 8


def test_the_gate_margin_does_not_hide_faults_of_new_vehicles() -> None:
    """Faults of about two metres or metres a second, between the fourth and the tenth second."""
    frames = FleetFrames(200, 12.0, seed=2, inject=Spec(c=4.0, kinds=(Kind.NOISE, Kind.BIAS), samples=(5, 20)))
    received = Roadside()
    for frame in frames:
        received.take(frame)
    young = [label for label in frames.labels if 4e6 < label.start_us < 10e6]
    found = [
        any(who == label.vehicle and label.start_us <= t_us <= label.stop_us + 1e6 for who, t_us in received.onsets)
        for label in young
    ]
    assert len(young) > 100
    assert np.mean(found) > 0.75
