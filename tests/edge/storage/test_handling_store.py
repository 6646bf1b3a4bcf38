"""How vehicles are handled is kept in the journal's file with who and when, published, and listed."""

import json
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from edge.storage.updates import detected, update
from sim.clock import FakeClock
from sim.memory_bus import MemoryQuery
from sim.rig import IDENTITY, KEYS
from sim.until import until

from headway.edge.storage import handling_store
from headway.edge.storage.handling_store import HandlingQueryable, newest, store
from headway.edge.storage.journal import Journal
from headway_schemas.handling import Action, Handling

HOUR_US = 3_600_000_000


@pytest.fixture
def journal(tmp_path: Path) -> Path:
    file = tmp_path / "journal.sqlite"
    Journal(file, site=IDENTITY.site, instance=IDENTITY.instance, days=1.0, megabytes=10.0).write([update(1)])
    return file


def handling(vehicle: str, action: Action, t_us: int = 1, site: str = IDENTITY.site, **more: object) -> Handling:
    return Handling(site=site, vehicle=vehicle, action=action, by="anna", t_us=t_us, **more)  # type: ignore[arg-type]


def asked(journal: Path, payload: bytes) -> tuple[MemoryQuery, list[Handling]]:
    published: list[Handling] = []
    answering = HandlingQueryable(journal, IDENTITY.site, FakeClock(), published.append)
    query = MemoryQuery(KEYS.handling, payload=payload)
    answering.ask(query)
    until(lambda: bool(query.answers or query.refusals))
    answering.close()
    return query, published


def test_of_each_vehicle_the_newest_decision_and_the_newest_note_are_listed(journal: Path) -> None:
    made = [
        handling("a", Action.ACKNOWLEDGE, 1),
        handling("a", Action.NOTE, 2, note="called the driver"),
        handling("a", Action.MUTE, 3, until_us=HOUR_US),
        handling("b", Action.RESOLVE, 4),
        handling("a", Action.RESOLVE, 5, site="elsewhere"),
    ]
    for one in made:
        store(journal, one)
    assert newest(journal, IDENTITY.site) == made[1:4]
    assert newest(journal) == made[1:]
    assert detected(journal) == [1]


def test_a_request_is_stored_published_and_answered(journal: Path) -> None:
    query, published = asked(journal, b'{"vehicle": "a", "action": "mute", "by": "anna", "until_us": 9}')
    [answered] = json.loads(query.answers[0])
    assert (answered["site"], answered["vehicle"], answered["by"], answered["until_us"]) == ("s", "a", "anna", 9)
    assert newest(journal) == published == [Handling.model_validate_json(json.dumps(answered))]


def test_without_a_payload_the_newest_are_listed(journal: Path) -> None:
    assert json.loads(asked(journal, b"")[0].answers[0]) == []
    store(journal, handling("a", Action.ACKNOWLEDGE))
    query, published = asked(journal, b"")
    assert [one["action"] for one in json.loads(query.answers[0])] == ["acknowledge"]
    assert published == []


@pytest.mark.parametrize(
    ("payload", "named"),
    [(b'{"vehicle": "a/b", "action": "mute", "by": "x"}', "vehicle"), (b'{"vehicle": "a", "action": "mute"}', "by"),
     (b'{"vehicle": "a", "action": "delete", "by": "x"}', "action"), (b"[", "")],
)  # fmt: skip
def test_a_request_that_makes_no_sense_is_refused_by_name(journal: Path, payload: bytes, named: str) -> None:
    query, published = asked(journal, payload)
    assert query.refusals[0].startswith(named)
    assert published == newest(journal) == []


def test_without_a_journal_a_request_is_refused(tmp_path: Path) -> None:
    query, _ = asked(tmp_path / "none.sqlite", b'{"vehicle": "a", "action": "note", "by": "x"}')
    assert query.refusals[0].startswith("the journal cannot be used (no_access)")


def test_many_handlings_leave_the_file_to_the_journal(tmp_path: Path) -> None:
    path = tmp_path / "own.sqlite"
    writer = Journal(path, site=IDENTITY.site, instance=IDENTITY.instance, days=1.0, megabytes=10.0)
    writer.write([update(1)])
    changed_ns = path.stat().st_mtime_ns
    for n in range(1_000):
        store(path, handling("a", Action.NOTE, n, note="x" * 200))
    assert path.stat().st_mtime_ns == changed_ns
    writer.close()
    assert len(newest(path)) == 1


def test_the_oldest_are_dropped(journal: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(handling_store, "HANDLINGS_MAX", 3)
    for n in range(6):
        store(journal, handling(f"car{n}", Action.ACKNOWLEDGE, n))
    with closing(sqlite3.connect(journal)) as db:
        assert db.execute("SELECT vehicle FROM handlings ORDER BY id").fetchall() == [("car3",), ("car4",), ("car5",)]


@pytest.mark.parametrize(
    ("action", "until_us", "onset_us", "is_open", "now_us", "expected"),
    [
        (Action.MUTE, 10, 7, True, 9, True),
        (Action.MUTE, 10, 7, True, 10, False),
        (Action.MUTE, None, 4, True, 99, True),
        (Action.MUTE, None, 4, False, 99, False),
        (Action.MUTE, None, 6, True, 99, False),
        (Action.RESOLVE, None, 4, True, 9, True),
        (Action.RESOLVE, None, 6, True, 9, False),
        (Action.ACKNOWLEDGE, None, 6, True, 9, True),
        (Action.UNMUTE, None, 4, True, 9, False),
    ],
)
def test_what_is_in_force_for_an_event(
    action: Action, until_us: int | None, onset_us: int, is_open: bool, now_us: int, expected: bool
) -> None:
    one = handling("a", action, 5, until_us=until_us)
    assert one.is_in_force(onset_us=onset_us, is_open=is_open, now_us=now_us) is expected
