"""The inbox: bounded in messages and bytes, the stalest shed first, and every message counted once."""

from headway.edge.arrival import Arrival
from headway.edge.inbox import Inbox

PLENTY = 1_000_000


def message(n: int, size: int = 10) -> Arrival:
    return Arrival(f"v2x/s/bsm/{n}", b"x" * size, "", True, n, n)


def numbers(arrivals: list[Arrival]) -> list[int]:
    return [arrival.received_us for arrival in arrivals]


def test_drains_the_oldest_first_up_to_the_limit() -> None:
    inbox = Inbox(PLENTY, PLENTY, lambda _: 1)
    for n in range(5):
        inbox.put(message(n))
    assert numbers(inbox.drain(3, PLENTY)) == [0, 1, 2]
    assert numbers(inbox.drain(3, PLENTY)) == [3, 4]
    assert inbox.drain(3, PLENTY) == []


def test_a_drain_ends_with_the_message_that_reaches_the_limit_of_bytes() -> None:
    inbox = Inbox(PLENTY, PLENTY, lambda _: 1)
    for n in range(5):
        inbox.put(message(n, 100))
    assert numbers(inbox.drain(PLENTY, 150)) == [0, 1]
    assert numbers(inbox.drain(PLENTY, 1)) == [2]


def test_when_too_many_wait_the_stalest_is_shed_and_its_records_are_counted() -> None:
    inbox = Inbox(3, PLENTY, lambda arrival: arrival.received_us + 10)
    for n in range(5):
        inbox.put(message(n))
    assert numbers(inbox.drain(PLENTY, PLENTY)) == [2, 3, 4]
    assert (inbox.received, inbox.shed, inbox.shed_records) == (5, 2, 10 + 11)


def test_when_too_many_bytes_wait_the_stalest_are_shed() -> None:
    inbox = Inbox(PLENTY, 100, lambda _: 1)
    for n in range(4):
        inbox.put(message(n, 40))
    assert numbers(inbox.drain(PLENTY, PLENTY)) == [2, 3]
    inbox.put(message(9, 101))
    assert len(inbox) == 0
    inbox.put(message(10, 100))
    assert numbers(inbox.drain(PLENTY, PLENTY)) == [10]
    assert inbox.received == inbox.shed + 3
