"""Waiting for a message with a time-out, which zenoh's channel does not offer."""

import threading
from contextlib import suppress
from queue import Empty, SimpleQueue
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
        self._arrived: SimpleQueue[object] = SimpleQueue()
        self._first: list[zenoh.Sample] = []
        self._has_channel = False
        threading.Thread(target=self._run, name="headway-arrivals", daemon=True).start()

    def wait(self, timeout_s: float) -> None:
        """Wait for a message or a wake-up."""
        if not self._has_channel:
            self._has_channel = True
            self._asked.put(True)  # noqa: FBT003 - an item of a queue
        with suppress(Empty):
            self._accept(self._arrived.get(timeout=timeout_s))

    def wake(self) -> None:
        """End a wait; any thread may call this."""
        if self._arrived.empty():
            self._arrived.put(None)

    def take(self) -> list[zenoh.Sample] | None:
        """Return what the thread received; None while the channel belongs to it."""
        while self._has_channel and not self._arrived.empty():
            self._accept(self._arrived.get())
        if self._has_channel:
            return None
        first, self._first = self._first, []
        return first

    def close(self) -> None:
        """End the thread; the subscriber is undeclared."""
        self._asked.put(False)  # noqa: FBT003 - an item of a queue

    def _accept(self, arrived: object) -> None:
        if arrived is not None:
            self._has_channel = False
        if isinstance(arrived, zenoh.Sample):
            self._first.append(arrived)

    def _run(self) -> None:
        while self._asked.get():
            try:
                self._arrived.put(self._incoming.recv())
            except zenoh.ZError:  # unsubscribed
                self._arrived.put(_CLOSED)
