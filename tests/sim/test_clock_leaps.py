"""The system clock leaps for six seconds: messages are refused by name meanwhile, and nothing else happens."""

import pytest
from sim.world import SimWorld

from headway.core.types.outcome import Outcome
from headway.edge.transport.ports import Channel

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
