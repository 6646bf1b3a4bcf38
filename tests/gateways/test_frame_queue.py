from hypothesis import given
from hypothesis import strategies as st

from headway.gateways.frame_queue import QUEUE_FULL, SOURCES_MAX, TOO_LARGE, FrameQueue
from headway_schemas.frames import Frame, is_bundle, pack, unpack


def frames(*sizes: int) -> list[Frame]:
    return [Frame(bytes(size), place, "here") for place, size in enumerate(sizes)]


def test_the_stalest_frames_give_way() -> None:
    queue = FrameQueue(3, 100)
    queue.put(frames(1, 2, 3, 4, 5))
    assert [len(frame.payload) for frame in queue.take(10, 10_000)] == [3, 4, 5]
    assert queue.dropped[QUEUE_FULL] == 2


def test_a_frame_beyond_the_largest_is_named() -> None:
    queue = FrameQueue(3, 4)
    queue.put(frames(4, 5))
    assert (len(queue), queue.dropped[TOO_LARGE]) == (1, 1)


def test_a_bundle_has_at_most_so_many_frames_and_bytes_but_at_least_one() -> None:
    queue = FrameQueue(100, 1000)
    queue.put(frames(*[100] * 20))
    assert len(queue.take(7, 10_000)) == 7
    assert len(queue.take(7, 300)) == 2
    assert len(queue.take(7, 1)) == 1
    assert len(FrameQueue(1, 1).take(7, 10)) == 0


def test_sources_are_counted_up_to_a_bound() -> None:
    queue = FrameQueue(10, 10)
    for number in range(SOURCES_MAX + 5):
        queue.put([Frame(b"", 0, f"10.0.0.{number}")])
    assert (len(queue.by_source), queue.by_source["other"]) == (SOURCES_MAX + 1, 5)


@given(st.lists(st.one_of(st.lists(st.integers(0, 12), max_size=9), st.integers(1, 5)), max_size=30))
def test_every_frame_is_accounted_for(steps: list[list[int] | int]) -> None:
    queue, taken = FrameQueue(7, 10), 0
    for step in steps:
        if isinstance(step, int):
            taken += len(queue.take(step, 40))
        else:
            queue.put(frames(*step))
        assert queue.received == taken + sum(queue.dropped.values()) + len(queue)
        assert len(queue) <= 7


@given(st.lists(st.builds(Frame, st.binary(max_size=80), st.integers(0, 2**53 - 1), st.text(max_size=20)), min_size=1))
def test_a_bundle_reads_back(sent: list[Frame]) -> None:
    payload = pack(sent)
    assert is_bundle(payload)
    assert unpack(payload, len(sent)) == sent
