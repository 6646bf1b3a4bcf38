"""Which messages are kept, how long, and in how much memory."""

from collections.abc import Sequence

import pytest
from edge.codec.messages import KEYS, RECEIVED_US, received, record

from headway.edge.codec.decoder import Codec
from headway.edge.message_history import AGE_NS, MESSAGES_MAX, MessageHistory
from headway.edge.transport.message import ReceivedMessage

OFFSET_US = 7
CODEC = Codec(KEYS)


def message(sender: str, n: int, size: int = 0) -> ReceivedMessage:
    """Return the message with which `sender` says that the event time is `n`, a tenth of a second after the last."""
    padding = record("x" * 60)
    content = [record(sender, t_us=n), *[padding] * size] if size else record(sender, t_us=n)
    return received(content, "gw-1")._replace(received_ns=n * 100_000_000, received_us=RECEIVED_US + n)


def add(history: MessageHistory, messages: Sequence[ReceivedMessage]) -> None:
    history.add(messages, CODEC.decode(messages), OFFSET_US)


def times(history: MessageHistory, vehicle: str, until_us: int = 10**9) -> list[int]:
    return [one.received_us - RECEIVED_US - OFFSET_US for one in history.of(vehicle, until_us)]


@pytest.fixture
def history() -> MessageHistory:
    return MessageHistory(1 << 20, 100_000)


def test_the_newest_of_one_vehicle_up_to_a_time_oldest_first(history: MessageHistory) -> None:
    for n in range(8):
        add(history, [message("a", n), message("b", n)])
    assert times(history, "a") == list(range(8))
    assert times(history, "b", until_us=5) == list(range(6))
    assert times(history, "c") == []
    add(history, [message("a", 8), message("a", 9)])
    assert times(history, "a") == list(range(10))
    assert [one.payload for one in history.of("b", 0)] == [message("b", 0).payload]


def test_an_id_that_begins_as_another_is_another(history: MessageHistory) -> None:
    add(history, [message("vehicle-1", 0), message("vehicle-10", 1)])
    assert times(history, "vehicle-1") == [0]


def test_what_is_old_is_dropped(history: MessageHistory) -> None:
    for n in range(200):
        add(history, [message("a", n)])
    kept = times(history, "a")
    assert kept[-1] == 199
    assert len(kept) == MESSAGES_MAX
    add(history, [message("b", 199 + AGE_NS // 100_000_000 + 1)])
    assert times(history, "a") == []


def test_memory_is_bounded_and_counted_back(history: MessageHistory) -> None:
    small = MessageHistory(100_000, 100_000)
    for n in range(50):
        add(small, [message("a", n, size=100)])
        assert small.size <= 100_000
    assert 1 <= len(times(small, "a")) < 10
    for n in range(50, 200):
        add(small, [message("a", n)])
    empty = MessageHistory(0, 100_000)
    add(empty, [message("a", 1)])
    assert (times(empty, "a"), empty.size) == ([], 0)


def test_an_event_has_so_many_bytes_of_the_newest() -> None:
    size = len(message("a", 0).payload)
    history = MessageHistory(1 << 20, 3 * size)
    for n in range(8):
        add(history, [message("a", n)])
    assert times(history, "a") == [5, 6, 7]


def test_messages_without_a_record_are_not_kept(history: MessageHistory) -> None:
    add(history, [received(b"\xc1")])
    add(history, [])
    assert history.size == 0
