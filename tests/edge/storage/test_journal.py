"""The journal: what was stated is there, on the page where it belongs, until it is too old or too much."""

import json
import os
import sqlite3
import tempfile
from contextlib import closing
from pathlib import Path

import pytest
from edge.storage.updates import detected, found, update
from hypothesis import given, settings
from hypothesis import strategies as st
from sim.rig import IDENTITY

from headway.core.types.records import Kind, Sensor
from headway.core.types.step_result import Phase
from headway.edge.storage import journal as journal_module
from headway.edge.storage import journal_format, journal_query
from headway.edge.storage.journal import PRUNE_AT_ONCE, EventUpdate, Journal
from headway.edge.storage.journal_format import Reason, reason_of
from headway_schemas.query import AlertsQuery

DAY_US = 86_400_000_000


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "state" / "journal.sqlite"


def journal_at(path: Path, days: float = 30.0, megabytes: float = 100.0) -> Journal:
    return Journal(path, site=IDENTITY.site, instance=IDENTITY.instance, days=days, megabytes=megabytes)


def test_a_statement_comes_back_byte_for_byte_and_without_its_evidence_unless_asked(path: Path) -> None:
    put = [update(1), update(2, evidence=None, kind=Kind.MISS, sensor=Sensor.BOTH)]
    journal_at(path).write(put)
    asked = AlertsQuery(evidence=True)
    assert journal_query.page(path, asked) == [put[1].payload, put[0].payload]
    light = [published | {"evidence": None} for published in map(json.loads, (put[1].payload, put[0].payload))]
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
            published = found(path, limit=limit, before_us=before_us)
            walked += published
            if len(published) < limit:
                break
            before_us = published[-1]["detected_us"]
        writer.close()
    assert sorted(published["event_id"] for published in walked) == sorted(f"e{n}" for n in range(len(at)))
    assert [published["detected_us"] for published in walked] == sorted(at, reverse=True)


def test_evidence_that_would_make_a_message_too_large_is_left_out_of_the_oldest(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    journal_at(path).write([update(n) for n in range(1, 9)])
    [one] = journal_query.read(path, AlertsQuery(evidence=True, from_us=8))
    assert one.evidence is not None
    monkeypatch.setattr(journal_query, "_EVIDENCE_BYTES", 3 * len(one.evidence))
    published = found(path, evidence=True)
    assert [event["evidence"] is not None for event in published] == [True] * 3 + [False] * 5


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
    other = EventUpdate(other.event.model_copy(update={"site": "elsewhere"}), other.key, other.payload)
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


def test_of_too_much_the_oldest_evidence_goes_first_then_details_then_events(path: Path) -> None:
    writer = journal_at(path, megabytes=1.0)
    for first in range(1, 3_001, 100):
        phases = (Phase.ONSET, Phase.CLEARED)
        writer.write([update(n, event_id=f"e{n}", phase=phase) for n in range(first, first + 100) for phase in phases])
        while writer.prune(first):
            pass
    assert writer.used_bytes <= 1_500_000
    newest = found(path, limit=10, evidence=True)
    assert [event["evidence"] is not None for event in newest] == [False, True] * 5
    kept = found(path, limit=1000, phase=Phase.CLEARED)
    assert len(kept) > 700
    assert "nis" in kept[0]
    assert "nis" not in kept[-1]
    assert {name: kept[-1][name] for name in ("event_id", "phase", "kind", "suspect", "t_us")} == {
        "event_id": f"e{3_001 - len(kept)}", "phase": "cleared", "kind": "bias", "suspect": "car1",
        "t_us": 3_001 - len(kept),
    }  # fmt: skip
    assert path.stat().st_size < 2_000_000


def test_a_month_of_the_alarms_of_a_thousand_vehicles_fits(path: Path) -> None:
    """At one an hour and vehicle 720,000 events: of two updates each, in 1 GB."""
    writer = journal_at(path, megabytes=1.0)
    phases = (Phase.ONSET, Phase.CLEARED)
    writer.write([update(n, event_id=f"car1-{n}", phase=phase) for n in range(1, 1_001) for phase in phases])
    while writer.prune(1_001):
        pass
    assert len(found(path, limit=1000, phase=Phase.CLEARED)) >= 1e6 / 1_380


def test_an_event_has_an_onset_a_newest_update_and_an_end(path: Path) -> None:
    writer = journal_at(path)
    for n, phase in enumerate([Phase.ONSET, Phase.UPDATE, Phase.UPDATE, Phase.CLEARED], 1):
        writer.write([update(n, event_id="e1", phase=phase), update(n, event_id="other", phase=Phase.UPDATE)])
        left = {1: [1], 2: [2, 1], 3: [3, 1], 4: [4, 1]}[n]
        assert [published["detected_us"] for published in found(path, event="e1")] == left
    assert [published["detected_us"] for published in found(path, event="other")] == [4]


def test_the_newest_update_of_each_event_stands_for_it(path: Path) -> None:
    kinds = [("a", Phase.ONSET, Kind.UNKNOWN), ("b", Phase.ONSET, Kind.BIAS), ("a", Phase.UPDATE, Kind.DRIFT)]
    journal_at(path).write(
        [update(n, n + 1, event_id=name, phase=phase, kind=kind) for n, (name, phase, kind) in enumerate(kinds)]
    )
    assert [(e["event_id"], e["kind"]) for e in found(path, newest=True)] == [("a", "drift"), ("b", "bias")]
    assert [e["event_id"] for e in found(path, newest=True, kind="unknown")] == []
    assert detected(path, newest=True, limit=1) == [2]


def test_a_part_of_an_id_is_enough(path: Path) -> None:
    journal_at(path).write([update(1, suspect="rsu-17", follower="x"), update(2, suspect="abc", leader="l_1")])
    assert detected(path, vehicle_part="su-1") == [1]
    assert detected(path, vehicle_part="_1") == [2]
    assert detected(path, vehicle_part="l.1") == []


def test_what_a_process_left_behind_is_there_for_the_next(path: Path) -> None:
    writer = journal_at(path)

    def numbered(n: int, event_id: str, phase: Phase) -> EventUpdate:
        return update(n, event_id=event_id, phase=phase, sequence=n)

    row = writer.write([numbered(1, "ended", Phase.ONSET), numbered(2, "ended", Phase.CLEARED)])
    writer.mark_published(row)
    writer.write([numbered(3, "open", Phase.ONSET), numbered(4, "open", Phase.UPDATE)])
    writer.close()
    resumed = journal_at(path).resume()
    assert (resumed.newest_us, resumed.sequence) == (4, 4)
    assert [event.sequence for event in resumed.unpublished] == [3, 4]
    assert [event.evidence is not None for event in resumed.unpublished] == [True, False]
    assert [(event.event_id, event.sequence) for event in resumed.open_events] == [("open", 4)]


def test_an_update_in_the_place_of_one_that_was_published_is_not_taken_for_it(path: Path) -> None:
    writer = journal_at(path)
    row = writer.write(
        [update(n, event_id="e", phase=phase, sequence=n) for n, phase in ((1, Phase.ONSET), (2, Phase.UPDATE))]
    )
    writer.mark_published(row)
    assert writer.write([update(3, event_id="e", phase=Phase.CLEARED, sequence=3)]) > row
    assert [event.sequence for event in writer.resume().unpublished] == [3]


def test_nor_is_one_in_a_journal_that_has_become_empty(path: Path) -> None:
    writer = journal_at(path, days=1.0)
    writer.mark_published(writer.write([update(1, sequence=1)]))
    assert writer.prune(2 * DAY_US) == 1
    writer.write([update(2 * DAY_US, sequence=1)])
    assert [event.detected_us for event in writer.resume().unpublished] == [2 * DAY_US]


def test_a_file_that_was_deleted_is_noticed_and_made_again(path: Path) -> None:
    writer = journal_at(path)
    writer.write([update(1)])
    assert writer.check()
    path.unlink()
    assert not writer.check()
    writer.write([update(2)])
    assert detected(path) == [2]


def test_a_file_that_was_damaged_is_moved_aside_and_made_again(path: Path) -> None:
    writer = journal_at(path)
    writer.write([update(n) for n in range(1, 100)])
    writer.close()
    writer = journal_at(path)
    content = bytearray(path.read_bytes())
    content[4096:] = b"x" * (len(content) - 4096)
    path.write_bytes(content)
    with pytest.raises(sqlite3.DatabaseError):
        writer.check_content()
    writer.write([update(200)])
    assert detected(path) == [200]
    assert path.with_name("journal.sqlite.damaged").read_bytes() == content


def test_damage_of_old_pages_is_noticed_while_the_writer_has_the_newest_in_its_cache(path: Path) -> None:
    writer = journal_at(path)
    writer.write([update(n) for n in range(1, 400)])
    with closing(sqlite3.connect(path)) as db:
        db.execute("PRAGMA wal_checkpoint(PASSIVE)")
        [(first,)] = db.execute("SELECT event FROM details ORDER BY update_id LIMIT 1")
        assert writer.check()
    content = path.read_bytes()
    page = content.index(first.encode()) // 4096 * 4096
    path.write_bytes(content[:page] + b"x" * 4096 + content[page + 4096 :])
    with pytest.raises(sqlite3.DatabaseError):
        writer.check()


def test_a_journal_of_the_format_before_is_moved_aside(path: Path) -> None:
    path.parent.mkdir()
    with closing(sqlite3.connect(path)) as db:
        db.execute("PRAGMA user_version = 1")
    writer = journal_at(path)
    with pytest.raises(journal_format.OtherFormatError):
        writer.write([update(1)])
    writer.write([update(2)])
    assert detected(path) == [2]
    assert path.with_name("journal.sqlite.format-1").exists()


def test_a_reader_that_holds_the_file_open_does_not_let_the_log_grow(path: Path) -> None:
    writer = journal_at(path, megabytes=1.0)
    writer.write([update(1)])
    with closing(sqlite3.connect(path, isolation_level=None)) as reader:
        reader.execute("BEGIN")
        reader.execute("SELECT count(*) FROM updates").fetchone()
        with pytest.raises(sqlite3.OperationalError) as raised:
            list(map(writer.write, ([update(n)] for n in range(2, 2_000))))
        assert reason_of(raised.value) is Reason.HELD_OPEN
        wal = path.with_name("journal.sqlite-wal")
        assert path.stat().st_size + wal.stat().st_size < 2_000_000
        reader.execute("COMMIT")
    writer.write([update(5_000)])
    assert detected(path, limit=1) == [5_000]


def test_only_its_owner_can_read_it(path: Path) -> None:
    journal_at(path).write([update(1)])
    assert path.stat().st_mode & 0o777 == 0o600
    assert path.parent.stat().st_mode & 0o777 == 0o700


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
    monkeypatch.setattr(journal_module, "LOCK_S", 0.01)
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


def test_a_file_that_another_program_touches_is_checked_once(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    writer, checks = journal_at(path), list[int]()
    writer.write([update(1)])
    check_content = writer.check_content
    monkeypatch.setattr(writer, "check_content", lambda: (checks.append(1), check_content()))
    os.utime(path)
    writer.write([update(2)])
    assert [writer.check() for _ in range(3)] == [True] * 3
    assert checks == [1]


def test_a_page_that_another_program_overwrites_is_found_at_the_next_check(path: Path) -> None:
    writer = journal_at(path)
    writer.write([update(n) for n in range(200)])
    writer.close()
    writer.write([update(200)])
    assert writer.check()
    size = path.stat().st_size
    with path.open("r+b") as file:
        file.seek(size // 2)
        file.write(b"\xff" * 8_192)
    with pytest.raises(sqlite3.DatabaseError) as raised:
        writer.check()
    assert reason_of(raised.value) is Reason.CORRUPT
    assert path.with_name(path.name + ".damaged").exists()
    assert writer.check()
    writer.write([update(201)])
    assert detected(path) == [201]


def test_a_damaged_file_a_foreign_one_and_no_folder_have_their_reasons(tmp_path: Path) -> None:
    damaged, foreign, newer = (tmp_path / name for name in ("damaged", "foreign", "newer"))
    damaged.write_bytes(b"no database at all" * 1_000)
    with closing(sqlite3.connect(foreign)) as db:
        db.execute("CREATE TABLE somebody (elses)")
    with closing(sqlite3.connect(newer)) as db:
        db.execute(f"PRAGMA user_version = {journal_format.FORMAT + 1}")
    reasons = []
    for path in (damaged, foreign, newer, foreign / "journal.sqlite"):
        with pytest.raises((sqlite3.Error, OSError)) as raised:
            journal_at(path).write([update(1)])
        reasons.append(reason_of(raised.value))
    assert reasons == [Reason.CORRUPT, Reason.OTHER_FORMAT, Reason.OTHER_FORMAT, Reason.NO_ACCESS]
    assert (tmp_path / "damaged.damaged").read_bytes() == b"no database at all" * 1_000


def test_a_question_that_takes_too_long_is_given_up(path: Path) -> None:
    writer = journal_at(path)
    writer.write([update(n, evidence=None) for n in range(5_000)])
    with pytest.raises(sqlite3.OperationalError, match="interrupted"):
        list(journal_query.read(path, AlertsQuery(vehicle="nobody"), longest_s=-1.0))
