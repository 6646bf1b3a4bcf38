"""Statements are written, then told; whatever the disk does, each is told once, and in time."""

import sqlite3
import threading
from collections.abc import Callable
from pathlib import Path

import pytest
from edge.storage.updates import detected, update
from sim.clock import FakeClock
from sim.until import until
from structlog.testing import capture_logs

from headway.edge.storage import journal_writer as module
from headway.edge.storage.journal import EventUpdate, Journal, Resumed
from headway.edge.storage.journal_format import Reason
from headway.edge.storage.journal_writer import PUBLISH_AFTER_NS, JournalWriter


class Disk:
    """A journal that answers when it is told to, or fails with what it is given."""

    used_bytes = 0

    def __init__(self) -> None:
        self.free = threading.Event()
        self.free.set()
        self.error: Exception | None = None
        self.written: list[int] = []
        self.pruned_at: list[int] = []
        self.marked: list[int] = []
        self.resumed = Resumed()

    def write(self, updates: list[EventUpdate]) -> int:
        self.free.wait(10.0)
        if self.error is not None:
            raise self.error
        self.written += [one.event.detected_us for one in updates]
        return len(self.written)

    def prune(self, now_us: int) -> int:
        if self.error is not None:
            raise self.error
        self.pruned_at.append(now_us)
        return 0

    def mark_published(self, row: int) -> None:
        self.marked.append(row)

    def check(self) -> bool:
        return True

    def resume(self) -> Resumed:
        return self.resumed

    def close(self) -> None:
        pass


class Rigged:
    def __init__(self, disk: Disk) -> None:
        self.disk, self.clock = disk, FakeClock()
        self.published: list[int] = []
        self.journal_writer = JournalWriter(disk, lambda one: self.published.append(one.event.detected_us), self.clock)
        self.journal_writer.start()

    def put(self, *detected_us: int) -> None:
        self.journal_writer.put([update(t_us) for t_us in detected_us])

    def idle(self, holds: Callable[[], object]) -> None:
        until(holds)


@pytest.fixture
def rigged() -> Rigged:
    return Rigged(Disk())


def test_a_statement_is_in_the_journal_when_it_is_told(tmp_path: Path) -> None:
    path = tmp_path / "journal.sqlite"
    seen: list[list[int]] = []
    journal_writer = JournalWriter(
        Journal(path, site="local", instance="i", days=1.0, megabytes=10.0),
        lambda _: seen.append(detected(path)),
        FakeClock(),
    )
    journal_writer.start()
    journal_writer.put([update(1), update(2)])
    journal_writer.put([update(3)])
    journal_writer.close(10.0)
    assert seen == [[2, 1], [2, 1], [3, 2, 1]]
    assert (journal_writer.written, journal_writer.waiting, journal_writer.published_before_commit) == (3, 0, 0)


def test_while_the_disk_fails_all_is_told_counted_and_logged_once(rigged: Rigged) -> None:
    journal_writer, disk = rigged.journal_writer, rigged.disk
    with capture_logs() as logs:
        disk.error = sqlite3.OperationalError("database or disk is full")
        disk.error.sqlite_errorcode = sqlite3.SQLITE_FULL
        for n in range(5):
            rigged.put(2 * n, 2 * n + 1)
        until(lambda: len(rigged.published) == 10)
        assert journal_writer.trouble is Reason.DISK_FULL
        disk.error = None
        rigged.put(10)
        until(lambda: len(rigged.published) == 11)
    assert rigged.published == list(range(11))
    assert journal_writer.failed[Reason.DISK_FULL] == 10
    assert (journal_writer.written, journal_writer.trouble, journal_writer.waiting) == (1, None, 0)
    assert [entry["log_level"] for entry in logs] == ["error", "info"]
    journal_writer.close(10.0)


def test_a_disk_that_does_not_answer_delays_no_alert_by_more_than_a_second(rigged: Rigged) -> None:
    journal_writer, disk, clock = rigged.journal_writer, rigged.disk, rigged.clock
    disk.free.clear()
    rigged.put(1, 2)
    clock.sleep(0.5)
    rigged.put(3)
    journal_writer.tick(clock.monotonic_ns())
    assert rigged.published == []
    clock.sleep(0.6)
    journal_writer.tick(clock.monotonic_ns())
    assert rigged.published == [1, 2]
    clock.sleep(0.6)
    journal_writer.tick(clock.monotonic_ns())
    assert rigged.published == [1, 2, 3]
    disk.free.set()
    journal_writer.close(10.0)
    assert rigged.published == disk.written == [1, 2, 3]
    assert (journal_writer.published_before_commit, journal_writer.written) == (3, 3)


def test_what_the_disk_has_no_time_for_is_told_and_counted(rigged: Rigged, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "WAITING_MAX", 4)
    rigged.disk.free.clear()
    rigged.put(0)
    until(lambda: rigged.journal_writer.waiting == 0)
    for n in range(1, 10):
        rigged.put(n)
    assert rigged.published == [1, 2, 3, 4, 5]
    assert rigged.journal_writer.waiting == 4
    rigged.disk.free.set()
    rigged.journal_writer.close(10.0)
    assert sorted(rigged.published) == list(range(10))
    assert rigged.disk.written == [0, 6, 7, 8, 9]
    assert rigged.journal_writer.failed[Reason.QUEUE_FULL] == 5


def test_the_end_waits_only_so_long_and_leaves_nothing_untold(rigged: Rigged) -> None:
    rigged.disk.free.clear()
    rigged.put(1)
    rigged.put(2)
    rigged.journal_writer.close(0.05)
    assert rigged.published == [1, 2]
    rigged.disk.free.set()


def test_nothing_is_told_twice_when_the_loop_and_the_thread_tell_at_once(rigged: Rigged) -> None:
    journal_writer, clock = rigged.journal_writer, rigged.clock
    for n in range(300):
        rigged.put(3 * n, 3 * n + 1, 3 * n + 2)
        journal_writer.tick(clock.monotonic_ns() + 2 * PUBLISH_AFTER_NS)
    journal_writer.close(10.0)
    assert sorted(rigged.published) == list(range(900))


DAY_US = 86_400_000_000


def pruned_at(disk: Disk, clock: FakeClock, leap_us: int) -> int:
    """Return the time by which a journal is pruned while the clock is off by `leap_us`."""
    writer = JournalWriter(disk, lambda _: None, clock)
    writer.start()
    clock.leap(leap_us)
    until(lambda: len(disk.pruned_at) > 1)
    writer.close(10.0)
    return disk.pruned_at[-1]


@pytest.mark.parametrize("days", [31, 20 * 365])
def test_a_clock_that_leaps_ahead_deletes_nothing(days: int) -> None:
    disk, clock = Disk(), FakeClock()
    start_us = clock.wall_us()
    assert pruned_at(disk, clock, days * DAY_US) <= start_us + DAY_US


def test_a_clock_that_leaps_back_deletes_nothing() -> None:
    disk, clock = Disk(), FakeClock()
    start_us = clock.wall_us()
    assert pruned_at(disk, clock, -31 * DAY_US) < start_us


def test_a_machine_that_starts_a_month_ahead_deletes_nothing_for_an_hour() -> None:
    disk, clock = Disk(), FakeClock()
    disk.resumed = Resumed(newest_us=clock.wall_us() - 31 * DAY_US)
    with capture_logs() as logs:
        assert pruned_at(disk, clock, 0) == 0
    assert logs[0]["days"] == 31


def test_what_is_on_the_bus_is_noted_once_it_has_had_time_to_get_there(rigged: Rigged) -> None:
    writer, disk, clock = rigged.journal_writer, rigged.disk, rigged.clock
    rigged.put(1)
    until(lambda: disk.written == [1])
    until(lambda: len(disk.pruned_at) > 2)
    assert disk.marked == []
    clock.sleep(2.5)
    until(lambda: disk.marked == [1])
    rigged.put(2)
    writer.close(10.0)
    assert disk.marked == [1, 2]
