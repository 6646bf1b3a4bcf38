"""The right to publish for a site: who has it, and when it ends."""

from pathlib import Path

import pytest
from sim.clock import FakeClock

from headway.edge.fence import LEASE_EXPIRED, REPLACED, Fence, SupersededError
from headway.errors import UserError

LEASE_S = 8.0
"""Long, so that a test calls `look` and the thread does not."""


@pytest.fixture
def claimed(tmp_path: Path):
    """Makes a service of an epoch that has claimed the site, and the reasons for which it ended."""
    fences: list[Fence] = []

    def claim(epoch: int, clock: FakeClock, reasons: list[str]) -> Fence:
        fence = Fence(tmp_path / "state" / "site.epoch", epoch, LEASE_S, clock, reasons.append)
        fence.claim()
        fences.append(fence)
        return fence

    yield claim
    for fence in fences:
        fence.close()


def test_an_epoch_only_rises(claimed, tmp_path: Path) -> None:
    claimed(5, FakeClock(), [])
    for epoch in (4, 5):
        with pytest.raises(SupersededError, match=f"epoch {epoch}: .* has 5"):
            claimed(epoch, FakeClock(), [])
    assert (tmp_path / "state" / "site.epoch").read_text() == "5"


def test_a_service_ends_when_the_folder_has_a_higher_epoch(claimed) -> None:
    reasons: list[str] = []
    older = claimed(1, FakeClock(), reasons)
    older.look()
    assert older.permits()
    assert reasons == []
    claimed(2, FakeClock(), [])
    older.look()
    assert not older.permits()
    assert set(reasons) == {REPLACED}


def test_a_service_ends_when_the_bus_has_a_higher_epoch(claimed) -> None:
    reasons: list[str] = []
    fence = claimed(3, FakeClock(), reasons)
    fence.see(2)
    fence.see(3)
    assert fence.permits()
    fence.see(4)
    assert reasons == [REPLACED]
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
        since_ns = clock.monotonic_ns()
        claimed(epoch, clock, [])
        assert clock.monotonic_ns() - since_ns == waited_s * 1e9


def test_a_file_that_holds_no_number_is_refused(claimed, tmp_path: Path) -> None:
    (tmp_path / "state").mkdir()
    (tmp_path / "state" / "site.epoch").write_text("x")
    with pytest.raises(UserError, match="needs this file"):
        claimed(1, FakeClock(), [])
