"""The snapshot on disk: a file for each part of the rows, used where it fits and passed over where it does not."""

import math
import threading
import time
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sim.clock import START_US, FakeClock
from sim.until import until
from structlog.testing import capture_logs

from headway.core.engine import Engine
from headway.core.site.state import BLOCK_ROWS
from headway.core.types.batch import Batch
from headway.core.types.config import DetectorConfig
from headway.core.types.identifiers import id_column
from headway.edge.codec.evidence import parameters
from headway.edge.identity import Identity
from headway.edge.storage.snapshots import Snapshots

CONFIG = DetectorConfig(model="aekf", vehicle_capacity=100, warming_readings=20)
IDENTITY = Identity(
    site="s", instance="i", version="1", model="aekf", config_hash="c0ffee", parameters=parameters(CONFIG, "1", "abc")
)
INTERVAL_S = 10.0


def driven(vehicles: int = 70, steps: int = 40) -> Engine:
    """An engine that knows vehicles one behind the other, one of them under suspicion and one silent."""
    engine = Engine(CONFIG)
    nothing = np.full(vehicles, np.nan)
    for k in range(steps):
        t_us = np.full(vehicles, START_US - 100_000 * (steps - k))
        x_m = -30.0 * np.arange(vehicles) + 2.0 * k
        if k > steps - 8:
            x_m[5] += 50.0
        received = np.flatnonzero((np.arange(vehicles) != 9) | (k < steps - 14))
        records = Batch(
            ids=id_column([f"car{n}" for n in received]),
            leader_ids=id_column([None] * received.size),
            msg_cnt=np.full(received.size, k),
            t_us=t_us[received],
            received_us=t_us[received],
            lat_deg=42.0 + x_m[received] / 111_083.0,
            lon_deg=np.full(received.size, -83.0),
            speed_mps=np.full(received.size, 20.0),
            heading_deg=np.zeros(received.size),
            **dict.fromkeys(("accel_mps2", "accuracy_m", "length_m", "range_m", "range_rate_mps"), nothing[received]),
        )
        engine.step(records, int(t_us[0]))
    assert engine.active_events == 2
    return engine


def one_record(engine: Engine) -> Batch:
    """A further message of the vehicle in row 0."""
    track, nothing = engine.snapshot().tables["tracks"][0], np.full(1, np.nan)
    t_us = np.array([track["t_us"] + 100_000])
    return Batch(
        ids=id_column(["car0"]), leader_ids=id_column([None]), msg_cnt=np.array([track["msg_cnt"] + 1]), t_us=t_us,
        received_us=t_us, lat_deg=np.array([track["lat_deg"]]), lon_deg=np.array([-83.0]), speed_mps=np.array([20.0]),
        heading_deg=np.zeros(1),
        **dict.fromkeys(("accel_mps2", "accuracy_m", "length_m", "range_m", "range_rate_mps"), nothing),
    )  # fmt: skip


def snapshots(path: Path, engine: Engine, identity: Identity = IDENTITY) -> Snapshots:
    return Snapshots(path, INTERVAL_S, engine, identity, FakeClock())


def saved(folder: Path, engine: Engine) -> Path:
    path = folder / "state" / "s-i.snapshot"
    snapshots(path, engine).close()
    return path


def test_words_that_are_zero_take_no_room(tmp_path: Path) -> None:
    engine = driven()
    in_memory = sum(table.nbytes for table in engine.snapshot().tables.values())
    on_disk = sum(part.stat().st_size for part in saved(tmp_path, engine).iterdir())
    assert on_disk < 0.8 * in_memory


def test_what_was_known_is_known_again(tmp_path: Path) -> None:
    engine, other = driven(), Engine(CONFIG)
    path = saved(tmp_path, engine)
    assert snapshots(path, other).load() == 70
    before, after = engine.snapshot(), other.snapshot()
    assert before.ids == after.ids
    assert all(repr(before.tables[name].tolist()) == repr(after.tables[name].tolist()) for name in before.tables)
    assert (before.events, before.pair_events, before.misses) == (after.events, after.pair_events, after.misses)
    assert (len(after.events), len(after.misses)) == (1, 1)


def test_without_a_file_nothing_is_known_and_nothing_said(tmp_path: Path) -> None:
    with capture_logs() as logs:
        assert snapshots(tmp_path / "absent", Engine(CONFIG)).load() == 0
    assert logs == []


@pytest.mark.parametrize(
    ("other", "reason"),
    [
        (replace(IDENTITY, site="elsewhere"), "made with another site"),
        (replace(IDENTITY, parameters=parameters(replace(CONFIG, delay_s=1.0), "1", "abc")), "another delay_s"),
        (replace(IDENTITY, parameters=parameters(CONFIG, "2", "def")), "another core, version"),
    ],
)
def test_one_of_another_make_is_passed_over(tmp_path: Path, other: Identity, reason: str) -> None:
    path, engine = saved(tmp_path, driven()), Engine(CONFIG)
    with capture_logs() as logs:
        assert snapshots(path, engine, other).load() == 0
    [entry] = logs
    assert reason in entry["reason"]
    assert engine.vehicles == 0


@pytest.mark.parametrize("damage", [
    lambda content: content[:-1], lambda content: content[:40] + b"!" + content[41:], lambda _: b"\n", lambda _: b"",
    lambda _: b"[]\n%08x" % zlib.crc32(b"[]\n"), lambda content: b"{}\n" + content,
])  # fmt: skip
def test_a_damaged_part_is_left_out(tmp_path: Path, damage) -> None:
    folder, engine = saved(tmp_path, driven()), Engine(CONFIG)
    part = folder / "01.part"
    part.write_bytes(damage(part.read_bytes()))
    with capture_logs() as logs:
        assert snapshots(folder, engine).load() == 70 - BLOCK_ROWS
    assert [entry["log_level"] for entry in logs] == ["warning", "info"]


def test_times_are_shifted_by_what_the_clock_was_set_meanwhile(tmp_path: Path) -> None:
    engine, clock, hour_us = driven(), FakeClock(), 3_600_000_000
    received_us = engine.snapshot().tables["tracks"]["received_us"]
    clock.leap(hour_us)
    Snapshots(tmp_path, INTERVAL_S, engine, IDENTITY, clock).close()
    other = Engine(CONFIG)
    snapshots(tmp_path, other).load()
    assert (other.snapshot().tables["tracks"]["received_us"] == received_us + hour_us).all()


def test_the_first_begins_soon_and_the_next_at_the_interval(tmp_path: Path) -> None:
    engine, sizes, begun_ms = driven(), [], []
    take = engine.snapshot
    writing = snapshots(tmp_path, engine)

    def taken(stride: int = 1, phase: int = 0):
        part = take(stride, phase)
        if phase == 0:
            begun_ms.append(ms)
        sizes.append(len(part.ids))
        return part

    engine.snapshot = taken
    for ms in range(22_000):
        writing.tick(ms * 1_000_000)
        while writing._worker.waiting:
            time.sleep(1e-4)
    assert begun_ms[0] == 200
    assert begun_ms[1:] == pytest.approx([10_200, 20_200], abs=128)
    assert max(sizes) == BLOCK_ROWS
    engine.snapshot = take
    writing.close()
    assert writing.written == 3
    other = Engine(CONFIG)
    assert snapshots(tmp_path, other).load() == 70
    assert sorted(other.states().followers) == sorted(engine.states().followers)


def test_a_part_that_has_not_changed_is_not_written_again(tmp_path: Path) -> None:
    engine = driven()
    records = one_record(engine)
    nothing = Batch(**{name: getattr(records, name)[:0] for name in Batch.__slots__})
    engine.step(nothing, int(records.received_us[0]) - 50_000)  # ends the slot, with the searches for leaders
    writing = snapshots(tmp_path, engine)
    for round_s in (1, 11):
        for ms in range(10_000):
            writing.tick((round_s * 1_000 + ms) * 1_000_000)
            while writing._worker.waiting:
                time.sleep(1e-4)
        if round_s == 1:
            until((tmp_path / "63.part").exists)
            for part in tmp_path.glob("*.part"):
                part.write_bytes(b"untouched")
            records = one_record(engine)
            engine.step(records, int(records.received_us[0]))
    writing._worker.close(10.0)
    changed = [part.name for part in sorted(tmp_path.glob("*.part")) if part.read_bytes() != b"untouched"]
    assert changed == ["00.part"]


def test_without_a_vehicle_nothing_is_due_once_all_parts_are_written_so(tmp_path: Path) -> None:
    engine = Engine(CONFIG)
    writing = snapshots(tmp_path, engine)
    writing._worker.put, written = lambda task: task(), []
    writing._write, write = lambda place, *_: (written.append(place), write(place, *_)), writing._write
    for ms in range(22_000):
        writing.tick(ms * 1_000_000)
    assert writing.due_ns == math.inf
    assert written == list(range(64))
    engine.step(one_record(driven()))
    assert writing.due_ns < 22e9
    for ms in range(22_000, 33_000):
        writing.tick(ms * 1_000_000)
    assert written[64:] == [0, 63, 0]
    assert writing.written == 2
    other = Engine(CONFIG)
    assert snapshots(tmp_path, other).load() == 1


def test_long_iterations_make_no_snapshot_older(tmp_path: Path) -> None:
    """With 0.5 s between two iterations, and a new snapshot due every 10 s, one is written every 10 s."""
    writing = snapshots(tmp_path, driven())
    for half_s in range(1, 102):
        writing.tick(half_s * 500_000_000)
        while writing._worker.waiting:
            time.sleep(1e-4)
    writing._worker.close(10.0)
    assert writing.written == 5


def test_few_parts_are_copied_before_the_last_is_taken_to_be_written(tmp_path: Path) -> None:
    keeping, slow = snapshots(tmp_path / "s-i.snapshot", driven()), threading.Event()
    keeping._worker.put(slow.wait)
    for ms in range(10_000, 11_000):
        keeping.tick(ms * 1_000_000)
    assert keeping._worker.waiting <= 4
    slow.set()
    keeping.close()
    assert keeping.written == 1


def test_a_failure_is_counted_told_and_over_when_the_disk_is_back(tmp_path: Path) -> None:
    blocked = tmp_path / "state"
    blocked.write_text("no folder")
    keeping = snapshots(blocked / "s-i.snapshot", driven())
    with capture_logs() as logs:
        for ms in range(12_000):
            keeping.tick(ms * 1_000_000)
        keeping.close()
    assert keeping.failed >= 1
    assert keeping.trouble is not None
    assert [entry["log_level"] for entry in logs] == ["error"]
