"""The journal: what was stated is there, on the page where it belongs, until it is too old or too much."""

import json
import sqlite3
import tempfile
from contextlib import closing
from pathlib import Path

import pytest
from edge.storage.updates import detected, found, update
from hypothesis import given, settings
from hypothesis import strategies as st

from headway.core.types.records import Kind, Sensor
from headway.core.types.step_result import Phase
from headway.edge.storage import journal, journal_query
from headway.edge.storage.journal import PRUNE_AT_ONCE, Journal, Reason, reason_of
from headway_schemas.query import AlertsQuery

DAY_US = 86_400_000_000


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "state" / "journal.sqlite"


def journal_at(path: Path, days: float = 30.0, megabytes: float = 100.0) -> Journal:
    return Journal(path, days=days, megabytes=megabytes)


def test_a_statement_comes_back_byte_for_byte_and_without_its_evidence_unless_asked(path: Path) -> None:
    put = [update(1), update(2, evidence=None, kind=Kind.MISS, sensor=Sensor.BOTH)]
    journal_at(path).write(put)
    asked = AlertsQuery(evidence=True)
    assert journal_query.page(path, asked) == [put[1].payload, put[0].payload]
    light = [told | {"evidence": None} for told in map(json.loads, (put[1].payload, put[0].payload))]
    assert found(path) == light


@pytest.mark.parametrize(
    ("asked", "expected"),
    [
        ({"from_us": 20}, [40, 30, 20]),
        ({"to_us": 30}, [20, 10]),
        ({"to_us": 40, "before_us": 20}, [10]),
        ({"kind": "drift"}, [20]),
        ({"phase": Phase.CLEARED}, [30]),
        ({"vehicle": "car9"}, [40, 10]),
        ({"event": "e2"}, [20]),
        ({"limit": 2}, [40, 30]),
        ({"event": "nothing-of-that-name"}, []),
    ],
)
def test_a_question_is_answered_newest_first(path: Path, asked: dict, expected: list[int]) -> None:
    journal_at(path).write(
        [
            update(10, leader="car9"),
            update(20, kind=Kind.DRIFT, event_id="e2"),
            update(30, phase=Phase.CLEARED),
            update(40, suspect="car9", follower="car9"),
        ]
    )
    assert detected(path, **asked) == expected


@settings(max_examples=40, deadline=None)
@given(at=st.lists(st.integers(1, 12), max_size=40), limit=st.integers(1, 7))
def test_a_walk_through_the_pages_meets_each_statement_once(at: list[int], limit: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "j.sqlite"
        writer = journal_at(path)
        for n, t_us in enumerate(at):
            writer.write([update(t_us, event_id=f"e{n}")])
        writer.prune(13)
        walked, before_us = [], None
        while True:
            told = found(path, limit=limit, before_us=before_us)
            walked += told
            if len(told) < limit:
                break
            before_us = told[-1]["detected_us"]
        writer.close()
    assert sorted(told["event_id"] for told in walked) == sorted(f"e{n}" for n in range(len(at)))
    assert [told["detected_us"] for told in walked] == sorted(at, reverse=True)


def test_evidence_that_would_make_a_message_too_large_is_left_out_of_the_oldest(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    journal_at(path).write([update(n) for n in range(1, 9)])
    [one] = journal_query.read(path, AlertsQuery(evidence=True, from_us=8))
    assert one.evidence is not None
    monkeypatch.setattr(journal_query, "_EVIDENCE_BYTES", 3 * len(one.evidence))
    told = found(path, evidence=True)
    assert [event["evidence"] is not None for event in told] == [True] * 3 + [False] * 5


def test_another_process_goes_on_in_the_same_file_and_readers_see_it(path: Path) -> None:
    first = journal_at(path)
    first.write([update(1)])
    second = journal_at(path)
    second.write([update(2)])
    first.write([update(3)])
    assert detected(path) == [3, 2, 1]
    first.close()
    second.close()
    journal_at(path).write([update(4)])
    assert detected(path) == [4, 3, 2, 1]


def test_sites_share_a_file_and_see_their_own(path: Path) -> None:
    other = update(2)
    other = journal.EventUpdate(other.event.model_copy(update={"site": "elsewhere"}), other.key, other.payload)
    journal_at(path).write([update(1), other])
    assert detected(path) == [1]
    assert len(journal_query.page(path, AlertsQuery())) == 2


def test_the_parameters_of_all_evidence_are_kept_once(path: Path) -> None:
    writer = journal_at(path)
    for n in range(5):
        writer.write([update(n), update(n)])
    with closing(sqlite3.connect(path)) as db:
        assert db.execute("SELECT count(*), max(config_hash) FROM configs").fetchone() == (1, "c0ffee")


def test_what_is_too_old_is_pruned_a_step_at_a_time(path: Path) -> None:
    writer = journal_at(path, days=2.0)
    old, young = range(1, PRUNE_AT_ONCE + 11), range(DAY_US, DAY_US + 5)
    writer.write([update(t_us, evidence=None) for t_us in (*old, *young)])
    now_us = 2 * DAY_US + old[-1] + 1
    assert [writer.prune(now_us) for _ in range(3)] == [PRUNE_AT_ONCE, 10, 0]
    assert detected(path) == list(reversed(young))


def test_the_oldest_are_pruned_when_there_is_too_much(path: Path) -> None:
    writer = journal_at(path, megabytes=1.0)
    for n in range(1, 1_201):
        writer.write([update(n)])
    while writer.prune(2_000):
        pass
    assert writer.used_bytes <= 1_000_000
    kept = detected(path, limit=1000)
    assert 100 < len(kept) < 1_000
    assert kept == list(range(1_200, 1_200 - len(kept), -1))
    for n in range(1_201, 3_001):
        writer.write([update(n)])
        writer.prune(3_001)
    assert path.stat().st_size < 2_000_000
    assert detected(path, limit=1) == [3_000]


def test_a_full_disk_keeps_all_of_a_turn_or_none_and_is_over_when_there_is_room(path: Path) -> None:
    writer = journal_at(path)
    writer.write([update(1)])
    assert writer._db is not None
    pages = writer._db.execute("PRAGMA page_count").fetchone()[0]
    writer._db.execute(f"PRAGMA max_page_count = {pages + 2}")
    with pytest.raises(sqlite3.OperationalError) as raised:
        writer.write([update(n) for n in range(2, 50)])
    assert reason_of(raised.value) is Reason.DISK_FULL
    assert detected(path) == [1]
    writer.write([update(50)])
    assert detected(path) == [50, 1]


def test_a_file_that_another_process_holds_is_locked(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(journal, "LOCK_S", 0.01)
    writer = journal_at(path)
    writer.write([update(1)])
    writer.close()
    with closing(sqlite3.connect(path, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        with pytest.raises(sqlite3.OperationalError) as raised:
            writer.write([update(2)])
    assert reason_of(raised.value) is Reason.LOCKED
    writer.write([update(3)])
    assert detected(path) == [3, 1]


def test_a_damaged_file_a_foreign_one_and_no_folder_have_their_reasons(tmp_path: Path) -> None:
    damaged, foreign, newer = (tmp_path / name for name in ("damaged", "foreign", "newer"))
    damaged.write_bytes(b"no database at all" * 1_000)
    with closing(sqlite3.connect(foreign)) as db:
        db.execute("CREATE TABLE somebody (elses)")
    with closing(sqlite3.connect(newer)) as db:
        db.execute(f"PRAGMA user_version = {journal.FORMAT + 1}")
    reasons = []
    for path in (damaged, foreign, newer, damaged / "journal.sqlite"):
        with pytest.raises((sqlite3.Error, OSError)) as raised:
            journal_at(path).write([update(1)])
        reasons.append(reason_of(raised.value))
    assert reasons == [Reason.CORRUPT, Reason.OTHER_FORMAT, Reason.OTHER_FORMAT, Reason.NO_ACCESS]
    assert damaged.read_bytes() == b"no database at all" * 1_000


def test_a_question_that_takes_too_long_is_given_up(path: Path) -> None:
    writer = journal_at(path)
    writer.write([update(n, evidence=None) for n in range(5_000)])
    with pytest.raises(sqlite3.OperationalError, match="interrupted"):
        list(journal_query.read(path, AlertsQuery(vehicle="nobody"), longest_s=-1.0))
