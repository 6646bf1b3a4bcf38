"""Clock, disk and process fail at seeded moments: what was found is published, ended and written.

The system clock leaps for six seconds, the disk is full for some, and the process is killed.
"""

from pathlib import Path

import pytest
from sim.crashing_world import CrashingWorld
from sim.world import SimWorld

from headway.core.types.outcome import Outcome
from headway.edge.storage import journal_query
from headway.edge.storage.journal_format import Reason
from headway.edge.storage.persistence import JOURNAL_FILE
from headway.edge.transport.ports import Channel
from headway_schemas.event import Event
from headway_schemas.query import LIMIT_MAX, AlertsQuery

SECONDS, VEHICLES, EVICTED_S = 40.0, 8, 45.0
HOUR_US = 3_600_000_000
LEAP_S, BACK_S, END_S = 8.0, 14.0, 24.0


def leaping(by_us: int) -> SimWorld:
    """Return a world whose wall clock is off from `LEAP_S` to `BACK_S`."""
    world = SimWorld(3, loss=0.0, delay_s=(0.001, 0.02), doubled=0.0, garbled=0.0)
    clock, sleep, leaps = world.rig.clock, world.rig.clock.sleep, [(LEAP_S, by_us), (BACK_S, -by_us)]

    def sleep_and_leap(seconds: float) -> None:
        sleep(seconds)
        if leaps and clock.monotonic_ns() / 1e9 >= leaps[0][0]:
            clock.leap(leaps.pop(0)[1])

    clock.sleep = sleep_and_leap
    world.drive(8, END_S)
    return world


@pytest.mark.parametrize("by_us", [HOUR_US, -HOUR_US, 31 * 24 * HOUR_US, -31 * 24 * HOUR_US, 20 * 8_766 * HOUR_US])
def test_only_messages_are_refused(by_us: int) -> None:
    calm, world = leaping(0), leaping(by_us)
    ledger, expected = world.rig.ledger, calm.rig.ledger
    reason = Outcome.TOO_OLD if by_us > 0 else Outcome.FROM_THE_FUTURE
    refused = round((BACK_S - LEAP_S) / END_S * calm.records)
    assert ledger[reason] == pytest.approx(refused, rel=0.02)
    assert ledger.records == world.records == calm.records
    assert ledger.scored + ledger.warming == calm.records - ledger[reason]
    assert ledger.evicted == expected.evicted == 0
    assert world.rig.bus.on(Channel.ALERT) == []


def lived(seed: int, folder: Path, monkeypatch: pytest.MonkeyPatch, **faults: float) -> CrashingWorld:
    """Return a world after some driving, and after all vehicles have left."""
    world = CrashingWorld(seed, folder, monkeypatch, **faults)
    world.drive(VEHICLES, SECONDS)
    world.stop(EVICTED_S)
    return world


def written(folder: Path) -> list[Event]:
    stored = journal_query.page(folder / JOURNAL_FILE, AlertsQuery(limit=LIMIT_MAX))
    return [Event.model_validate_json(one) for one in stored]


@pytest.mark.parametrize("faults", [{"crashes": 0.15}, {"fatal_end": 4}], ids=["at any time", "between commit and bus"])
@pytest.mark.parametrize("seed", range(3))
def test_what_a_killed_process_found_is_published_and_ended(seed: int, faults, tmp_path: Path, monkeypatch) -> None:
    world = lived(seed, tmp_path, monkeypatch, **faults)
    assert world.crashes >= 3
    assert world.outcomes.total() == world.records
    phases = {phase: {a["event_id"] for a in world.alerts if a["phase"] == phase} for phase in ("onset", "cleared")}
    assert len(phases["onset"]) >= 8
    assert phases["onset"] <= phases["cleared"]
    updates = {(a["sequence"], a["event_id"], a["phase"], a["detected_us"]) for a in world.alerts}
    assert len({number for number, *_ in updates}) == len(updates), "one number for two updates"
    assert {event.sequence for event in written(tmp_path)} <= {number for number, *_ in updates}


def test_what_a_full_disk_refuses_is_published_and_counted(tmp_path: Path, monkeypatch) -> None:
    world = lived(1, tmp_path, monkeypatch, disk_faults=0.3)
    writer, snapshots = world.rig.persistence.journal_writer, world.rig.persistence.snapshots
    published = [alert["sequence"] for alert in world.alerts]
    assert published == list(range(1, len(published) + 1))
    assert writer.failed[Reason.DISK_FULL] == len(published) - writer.written > 0
    assert snapshots.failed > 0
    assert snapshots.written > 0
    assert (writer.trouble, snapshots.trouble) == (None, None), "it works again"


@pytest.mark.parametrize("seed", range(3, 6))
def test_both_at_once_stop_nothing_and_are_the_same_each_time(seed: int, tmp_path: Path, monkeypatch) -> None:
    worlds = []
    for run in ("first", "second"):
        with monkeypatch.context() as patch:
            worlds.append(lived(seed, tmp_path / run, patch, crashes=0.15, disk_faults=0.2))
    first, second = worlds
    assert first.crashes
    assert first.outcomes.total() == first.records
    assert first.alerts == second.alerts
    assert first.outcomes == second.outcomes
    assert (first.crashes, first.torn, first.unheard) == (second.crashes, second.torn, second.unheard)
