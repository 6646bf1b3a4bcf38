import threading

import pytest

from headway_loadtest.traffic.read_ahead import read_ahead


def threads():
    return [thread for thread in threading.enumerate() if thread.name == "read-ahead"]


def test_items_come_in_order_and_end():
    assert list(read_ahead(range(100), 3)) == list(range(100))
    assert list(read_ahead([], 3)) == []


def test_no_more_than_the_depth_is_read_ahead():
    read = []

    def items():
        for i in range(1000):
            read.append(i)
            yield i

    ahead = read_ahead(items(), 5)
    assert next(ahead) == 0
    ahead.close()
    assert len(read) <= 1 + 5 + 1


def test_an_error_comes_after_what_was_read_before_it():
    def items():
        yield 1
        raise ValueError("row 2")

    ahead = read_ahead(items(), 5)
    assert next(ahead) == 1
    with pytest.raises(ValueError, match="row 2"):
        next(ahead)


def test_the_thread_ends_when_nobody_reads_on():
    earlier = set(threads())
    ahead = read_ahead(iter(int, 1), 2)
    next(ahead)
    [reader] = set(threads()) - earlier
    ahead.close()
    reader.join(5.0)
    assert not reader.is_alive()
