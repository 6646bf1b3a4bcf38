"""The right to publish for a site: who has it, and when it ends."""

from pathlib import Path

import pytest
from sim.clock import FakeClock

from headway.edge.fence import LEASE_EXPIRED, REPLACED, Fence, SupersededError, newest_epoch, reserve
from headway.errors import UserError

LEASE_S = 8.0
"""Long, so that a test calls `look` and the thread does not."""
STOPS = "stops"


def waited(claimed, epoch: int, clock: FakeClock) -> float:
    """Return how long a service of this epoch waits after its claim, in seconds."""
    since_ns = clock.monotonic_ns()
    claimed(epoch, clock, [])
    return (clock.monotonic_ns() - since_ns) / 1e9


@pytest.fixture
def claimed(tmp_path: Path):
    """Makes a service of an epoch that has claimed the site, and the reasons for which it stopped or ended."""
    fences: list[Fence] = []

    def claim(epoch: int, clock: FakeClock, reasons: list[str]) -> Fence:
        file = tmp_path / "state" / "site.epoch"
        fence = Fence(file, epoch, LEASE_S, clock, lambda: reasons.append(STOPS), reasons.append)
        fence.claim()
        fences.append(fence)
        return fence

    yield claim
    for fence in fences:
        fence.release()


def test_an_epoch_only_rises(claimed, tmp_path: Path) -> None:
    claimed(5, FakeClock(), [])
    for epoch in (4, 5):
        with pytest.raises(SupersededError, match=f"epoch {epoch}: .* has 5"):
            claimed(epoch, FakeClock(), [])
    assert (tmp_path / "state" / "site.epoch").read_text() == "5"


def test_a_service_stops_within_its_lease_when_the_folder_has_a_higher_epoch(claimed) -> None:
    clock, reasons = FakeClock(), []
    older = claimed(1, clock, reasons)
    clock.sleep(LEASE_S / 2)
    older.look()
    assert reasons == []
    claimed(2, FakeClock(), [])
    clock.sleep(LEASE_S / 2)
    older.look()
    older.look()
    assert reasons == [STOPS]
    assert older.is_replaced
    clock.sleep(LEASE_S / 2)
    assert older.permits()
    clock.sleep(0.001)
    assert not older.permits()
    assert reasons == [STOPS, REPLACED]


def test_a_service_stops_when_the_bus_has_a_higher_epoch(claimed) -> None:
    clock, reasons = FakeClock(), []
    fence = claimed(3, clock, reasons)
    fence.see(2)
    fence.see(3)
    assert reasons == []
    fence.see(4)
    fence.see(4)
    assert reasons == [STOPS]
    clock.sleep(LEASE_S)
    fence.look()
    clock.sleep(0.001)
    assert not fence.permits()


def test_a_process_that_hung_for_a_lease_never_publishes_again(claimed) -> None:
    clock, reasons = FakeClock(), []
    fence = claimed(1, clock, reasons)
    clock.sleep(LEASE_S)
    assert fence.permits()
    clock.sleep(0.001)
    assert not fence.permits()
    fence.look()
    assert not fence.permits()
    assert set(reasons) == {LEASE_EXPIRED}


def test_the_lease_runs_while_the_folder_cannot_be_read(claimed, tmp_path: Path) -> None:
    clock, reasons = FakeClock(), []
    fence = claimed(1, clock, reasons)
    file = tmp_path / "state" / "site.epoch"
    for _ in range(3):
        clock.sleep(LEASE_S / 2)
        fence.look()
    assert fence.permits()
    file.unlink()
    for _ in range(3):
        clock.sleep(LEASE_S / 2)
        fence.look()
    assert reasons[0] == LEASE_EXPIRED


def test_the_next_service_waits_until_the_lease_before_it_has_ended(claimed) -> None:
    clock = FakeClock()
    for epoch, waited_s in ((1, 0.0), (2, LEASE_S)):
        assert waited(claimed, epoch, clock) == pytest.approx(waited_s, abs=0.021)


def test_the_next_service_does_not_wait_for_one_that_has_released_its_epoch(claimed) -> None:
    clock = FakeClock()
    older = claimed(1, clock, [])
    older.release()
    assert not older.permits()
    assert waited(claimed, 2, clock) == 0.0
    assert waited(claimed, 3, clock) == pytest.approx(LEASE_S, abs=0.021)


def test_the_lease_before_a_reserved_epoch_runs_while_the_service_starts(claimed, tmp_path: Path) -> None:
    file, clock, reasons = tmp_path / "state" / "site.epoch", FakeClock(), []
    older = claimed(1, clock, reasons)
    reserve(file, 2)
    assert newest_epoch(file) == 2
    older.look()
    assert reasons == [STOPS]
    starting = Fence(file, 2, LEASE_S, clock, lambda: None, reasons.append)
    clock.sleep(0.75 * LEASE_S)
    since_ns = clock.monotonic_ns()
    starting.claim()
    assert (clock.monotonic_ns() - since_ns) / 1e9 == pytest.approx(0.25 * LEASE_S, abs=0.021)
    starting.release()


def test_an_epoch_is_reserved_once_and_claimed_once(claimed, tmp_path: Path) -> None:
    file = tmp_path / "state" / "site.epoch"
    assert newest_epoch(file) == 0
    reserve(file, 2)
    for epoch in (1, 2):
        with pytest.raises(SupersededError):
            reserve(file, epoch)
    with pytest.raises(SupersededError):
        claimed(1, FakeClock(), [])
    claimed(2, FakeClock(), [])
    with pytest.raises(SupersededError):
        claimed(2, FakeClock(), [])


def test_a_file_that_holds_no_number_is_refused(claimed, tmp_path: Path) -> None:
    (tmp_path / "state").mkdir()
    (tmp_path / "state" / "site.epoch").write_text("x")
    with pytest.raises(UserError, match="needs this file"):
        claimed(1, FakeClock(), [])
