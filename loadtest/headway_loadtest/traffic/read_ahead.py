"""Reading ahead: a thread reads the next items while the current ones are played."""

import queue
import threading
from collections.abc import Iterable, Iterator
from typing import TypeVar

T = TypeVar("T")

STOP_CHECK_S = 0.1


class _End:
    """End of the items; `error` is the exception that ended them, if any."""

    def __init__(self, error: Exception | None = None) -> None:
        self.error = error


def read_ahead(items: Iterable[T], depth: int) -> Iterator[T]:
    """Yield the items, up to `depth` of them read beforehand; their error is raised in order.

    The thread ends with the items, or soon after the iterator is closed.
    """
    waiting: queue.Queue[T | _End] = queue.Queue(depth)
    closed = threading.Event()

    def offer(item: T | _End) -> None:
        while not closed.is_set():
            try:
                waiting.put(item, timeout=STOP_CHECK_S)
            except queue.Full:
                continue
            return

    def read() -> None:
        try:
            for item in items:
                offer(item)
                if closed.is_set():
                    return
            offer(_End())
        except Exception as error:  # noqa: BLE001  it is raised again by the reader
            offer(_End(error))

    threading.Thread(target=read, name="read-ahead", daemon=True).start()
    try:
        while not isinstance(item := waiting.get(), _End):
            yield item
        if item.error is not None:
            raise item.error
    finally:
        closed.set()
