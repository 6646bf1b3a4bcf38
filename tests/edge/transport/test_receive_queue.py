"""The inbox: bounded in messages and bytes, the stalest shed first, and every message counted once."""

from headway.core.types.outcome import Outcome
from headway.edge.transport.message import ReceivedMessage
from headway.edge.transport.receive_queue import ReceiveQueue

PLENTY = 1_000_000


def message(n: int, size: int = 10) -> ReceivedMessage:
    return ReceivedMessage(f"v2x/s/bsm/{n}", b"x" * size, "", True, n, n)


def numbers(received_messages: list[ReceivedMessage]) -> list[int]:
    return [received.received_us for received in received_messages]


def test_drains_the_oldest_first_up_to_the_limit() -> None:
    receive_queue = ReceiveQueue(PLENTY, PLENTY, PLENTY, len)
    for n in range(5):
        receive_queue.put([message(n)])
    assert numbers(receive_queue.drain(3, PLENTY, 0)) == [0, 1, 2]
    assert numbers(receive_queue.drain(3, PLENTY, 0)) == [3, 4]
    assert receive_queue.drain(3, PLENTY, 0) == []


def test_a_drain_ends_with_the_message_that_reaches_the_limit_of_bytes() -> None:
    receive_queue = ReceiveQueue(PLENTY, PLENTY, PLENTY, len)
    for n in range(5):
        receive_queue.put([message(n, 100)])
    assert numbers(receive_queue.drain(PLENTY, 150, 0)) == [0, 1]
    assert numbers(receive_queue.drain(PLENTY, 1, 0)) == [2]


def test_when_too_many_wait_the_stalest_is_shed_and_its_records_are_counted() -> None:
    receive_queue = ReceiveQueue(3, PLENTY, PLENTY, lambda shed: sum(received.received_us + 10 for received in shed))
    for n in range(5):
        receive_queue.put([message(n)])
    assert numbers(receive_queue.drain(PLENTY, PLENTY, 0)) == [2, 3, 4]
    assert (receive_queue.received, receive_queue.shed) == (5, 2)
    assert receive_queue.shed_records == {Outcome.SHED: 10 + 11, Outcome.STALE: 0, Outcome.RATE_EXCEEDED: 0}


def test_when_too_many_bytes_wait_the_stalest_are_shed() -> None:
    receive_queue = ReceiveQueue(PLENTY, 100, PLENTY, len)
    for n in range(4):
        receive_queue.put([message(n, 40)])
    assert numbers(receive_queue.drain(PLENTY, PLENTY, 0)) == [2, 3]
    receive_queue.put([message(9, 101)])
    assert len(receive_queue) == 0
    receive_queue.put([message(10, 100)])
    assert numbers(receive_queue.drain(PLENTY, PLENTY, 0)) == [10]
    assert receive_queue.received == receive_queue.shed + 3


def test_what_waited_too_long_is_shed_as_stale_and_makes_room() -> None:
    receive_queue = ReceiveQueue(PLENTY, 200, 100, lambda shed: 3 * len(shed))
    for n in (10, 20, 150, 160):
        receive_queue.put([message(n, 50)])
    assert numbers(receive_queue.drain(1, PLENTY, 121)) == [150]
    assert (receive_queue.shed, receive_queue.shed_records) == (
        2,
        {Outcome.SHED: 0, Outcome.STALE: 6, Outcome.RATE_EXCEEDED: 0},
    )
    receive_queue.put([message(170, 150)])
    assert numbers(receive_queue.drain(PLENTY, PLENTY, 260)) == [160, 170]
    receive_queue.put([message(300)])
    assert receive_queue.drain(PLENTY, PLENTY, 401) == []
    assert receive_queue.received == receive_queue.shed + 3


def of(sender: str, n: int, size: int = 10) -> ReceivedMessage:
    return ReceivedMessage(f"v2x/s/bsm/{sender}", b"x" * size, "", True, n, n)


def senders(received_messages: list[ReceivedMessage]) -> list[str]:
    return [received.key.rpartition("/")[2] for received in received_messages]


def test_a_vehicle_beyond_its_rate_is_refused_until_the_second_is_over() -> None:
    receive_queue = ReceiveQueue(PLENTY, PLENTY, 10**12, len, sender_rate_hz=10)
    receive_queue.put([of("flood", n) for n in range(1_000)] + [of("car", 0)])
    assert senders(receive_queue.drain(PLENTY, PLENTY, 0)) == ["flood"] * 10 + ["car"]
    assert receive_queue.shed_records[Outcome.RATE_EXCEEDED] == 990
    receive_queue.put([of("flood", 1_000_000_000)])
    assert senders(receive_queue.drain(PLENTY, PLENTY, 0)) == ["flood"]


def test_a_large_message_counts_as_several() -> None:
    receive_queue = ReceiveQueue(PLENTY, PLENTY, PLENTY, len, sender_rate_hz=10)
    receive_queue.put([of("car", n, 40_000) for n in range(3)])
    assert senders(receive_queue.drain(PLENTY, PLENTY, 0)) == ["car"]


def test_a_gateway_may_send_many_and_gives_way_when_the_queue_is_full() -> None:
    receive_queue = ReceiveQueue(100, PLENTY, PLENTY, len, sender_rate_hz=10)
    receive_queue.put([of("gw-flood", n) for n in range(1_000)])
    receive_queue.put([of(f"car{n}", n) for n in range(20)])
    receive_queue.put([of("gw-flood", n) for n in range(1_000)])
    left = senders(receive_queue.drain(PLENTY, PLENTY, 0))
    assert len(left) == 100
    assert [f"car{n}" for n in range(20)] == [sender for sender in left if sender != "gw-flood"]
    assert receive_queue.shed_records == {Outcome.SHED: 1_920, Outcome.STALE: 0, Outcome.RATE_EXCEEDED: 0}


def test_bytes_are_shed_from_the_busiest_as_well() -> None:
    receive_queue = ReceiveQueue(PLENTY, 1_000, PLENTY, len, sender_rate_hz=10**9)
    receive_queue.put([of("car", 0, 100), *(of("gw-a", n, 100) for n in range(30))])
    assert len(receive_queue) == 10
