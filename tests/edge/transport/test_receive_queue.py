"""The inbox: bounded in messages and bytes, the stalest shed first, and every message counted once."""

from headway.core.types.outcome import Outcome
from headway.edge.transport.message import Arrival
from headway.edge.transport.receive_queue import Inbox

PLENTY = 1_000_000


def message(n: int, size: int = 10) -> Arrival:
    return Arrival(f"v2x/s/bsm/{n}", b"x" * size, "", True, n, n)


def numbers(arrivals: list[Arrival]) -> list[int]:
    return [arrival.received_us for arrival in arrivals]


def test_drains_the_oldest_first_up_to_the_limit() -> None:
    inbox = Inbox(PLENTY, PLENTY, PLENTY, len)
    for n in range(5):
        inbox.put([message(n)])
    assert numbers(inbox.drain(3, PLENTY, 0)) == [0, 1, 2]
    assert numbers(inbox.drain(3, PLENTY, 0)) == [3, 4]
    assert inbox.drain(3, PLENTY, 0) == []


def test_a_drain_ends_with_the_message_that_reaches_the_limit_of_bytes() -> None:
    inbox = Inbox(PLENTY, PLENTY, PLENTY, len)
    for n in range(5):
        inbox.put([message(n, 100)])
    assert numbers(inbox.drain(PLENTY, 150, 0)) == [0, 1]
    assert numbers(inbox.drain(PLENTY, 1, 0)) == [2]


def test_when_too_many_wait_the_stalest_is_shed_and_its_records_are_counted() -> None:
    inbox = Inbox(3, PLENTY, PLENTY, lambda shed: sum(arrival.received_us + 10 for arrival in shed))
    for n in range(5):
        inbox.put([message(n)])
    assert numbers(inbox.drain(PLENTY, PLENTY, 0)) == [2, 3, 4]
    assert (inbox.received, inbox.shed) == (5, 2)
    assert inbox.shed_records == {Outcome.SHED: 10 + 11, Outcome.STALE: 0}


def test_when_too_many_bytes_wait_the_stalest_are_shed() -> None:
    inbox = Inbox(PLENTY, 100, PLENTY, len)
    for n in range(4):
        inbox.put([message(n, 40)])
    assert numbers(inbox.drain(PLENTY, PLENTY, 0)) == [2, 3]
    inbox.put([message(9, 101)])
    assert len(inbox) == 0
    inbox.put([message(10, 100)])
    assert numbers(inbox.drain(PLENTY, PLENTY, 0)) == [10]
    assert inbox.received == inbox.shed + 3


def test_what_waited_too_long_is_shed_as_stale_and_makes_room() -> None:
    inbox = Inbox(PLENTY, 200, 100, lambda shed: 3 * len(shed))
    for n in (10, 20, 150, 160):
        inbox.put([message(n, 50)])
    assert numbers(inbox.drain(1, PLENTY, 121)) == [150]
    assert (inbox.shed, inbox.shed_records) == (2, {Outcome.SHED: 0, Outcome.STALE: 6})
    inbox.put([message(170, 150)])
    assert numbers(inbox.drain(PLENTY, PLENTY, 260)) == [160, 170]
    inbox.put([message(300)])
    assert inbox.drain(PLENTY, PLENTY, 401) == []
    assert inbox.received == inbox.shed + 3
