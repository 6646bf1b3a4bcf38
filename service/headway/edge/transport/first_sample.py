"""Waiting for a message with a time-out, which zenoh's channel does not offer."""

import threading
from collections import deque
from queue import SimpleQueue
from typing import Final

import zenoh

_CLOSED: Final = object()


class FirstSample:
    """A thread that waits for the next message while the loop has nothing to do.

    It receives one message each time that the loop waits. The loop receives all others by itself, so under load this
    thread does nothing. While it waits, the channel belongs to it: a message taken past it would be out of order.
    """

    def __init__(self, incoming: zenoh.handlers.Handler[zenoh.Sample]) -> None:
        self._incoming = incoming
        self._asked: SimpleQueue[bool] = SimpleQueue()
        self._arrived: deque[object] = deque()
        self._bell = threading.Event()
        """Not a `SimpleQueue`: a signal that ends later than the time-out makes its `get` wait for ever."""
        self._has_channel = False
        threading.Thread(target=self._run, name="headway-arrivals", daemon=True).start()

    def wait(self, timeout_s: float) -> None:
        """Wait for a message or a wake-up."""
        if not self._has_channel:
            self._has_channel = True
            self._asked.put(True)  # noqa: FBT003 - an item of a queue
        self._bell.wait(timeout_s)
        self._bell.clear()

    def wake(self) -> None:
        """End a wait; any thread may call this."""
        self._bell.set()

    def take(self) -> list[zenoh.Sample] | None:
        """Return what the thread received; None while the channel belongs to it."""
        if self._has_channel and not self._arrived:
            return None
        self._has_channel = False
        first = self._arrived.popleft() if self._arrived else _CLOSED
        return [first] if isinstance(first, zenoh.Sample) else []

    def close(self) -> None:
        """End the thread; the subscriber is undeclared."""
        self._asked.put(False)  # noqa: FBT003 - an item of a queue

    def _run(self) -> None:
        while self._asked.get():
            try:
                self._arrived.append(self._incoming.recv())
            except zenoh.ZError:  # unsubscribed
                self._arrived.append(_CLOSED)
            self._bell.set()
