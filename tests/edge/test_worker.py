"""The outbox: whoever puts is never held up, however slow the act."""

import threading

from headway.edge.worker import Worker

SOON_S = 10.0


def test_acts_are_done_in_order_and_closing_waits_for_them() -> None:
    done: list[int] = []
    worker = Worker("t", 100, OSError)
    for n in range(50):
        worker.put(lambda n=n: done.append(n))
    assert worker.close(SOON_S)
    assert done == list(range(50))


def test_behind_a_blocked_act_the_oldest_are_dropped_and_counted() -> None:
    begun, go, done = threading.Event(), threading.Event(), list[int]()

    def block() -> None:
        begun.set()
        go.wait(SOON_S)

    worker = Worker("t", 3, OSError)
    worker.put(block)
    assert begun.wait(SOON_S)
    for n in range(5):
        worker.put(lambda n=n: done.append(n))
    assert worker.overflowed == 2
    assert not worker.close(0.0)
    go.set()
    assert worker.close(SOON_S)
    assert done == [2, 3, 4]


def test_a_failure_is_counted_and_the_next_act_is_done() -> None:
    done: list[int] = []

    def fail() -> None:
        raise OSError

    worker = Worker("t", 3, OSError)
    worker.put(fail)
    worker.put(lambda: done.append(1))
    assert worker.close(SOON_S)
    assert (worker.failed, done) == (1, [1])
