"""The bounded queue between a feed and the bus; when it is full, the stalest frames give way."""

import threading
from collections import Counter, deque
from collections.abc import Sequence
from typing import Final

from headway_schemas.frames import Frame

QUEUE_FULL, TOO_LARGE, PUT_FAILED = "queue_full", "too_large", "put_failed"
"""Why a frame that was received is dropped."""
_OVERHEAD_BYTES: Final = 16
"""Of a frame in a bundle, at most, besides its payload and its source."""
SOURCES_MAX: Final = 64
"""Sources that are counted apart; further ones count as `other`."""


class FrameQueue:
    """Holds the frames between the thread that receives and the one that forwards.

    `received` is always the sum of what was taken, what was dropped, and what waits.

    Parameters
    ----------
    frames_limit
        Most frames that wait.
    frame_bytes_max
        Size of the largest frame that is taken in.
    """

    def __init__(self, frames_limit: int, frame_bytes_max: int) -> None:
        self._frames: deque[Frame] = deque()
        self._frames_limit = frames_limit
        self._frame_bytes_max = frame_bytes_max
        self._changed = threading.Condition()
        self.received = 0
        self.dropped: Counter[str] = Counter()
        self.by_source: Counter[str] = Counter()

    def __len__(self) -> int:
        """Return how many frames wait."""
        return len(self._frames)

    def put(self, frames: Sequence[Frame]) -> None:
        """Append frames, oldest first."""
        fitting = [frame for frame in frames if len(frame.payload) <= self._frame_bytes_max]
        with self._changed:
            self.received += len(frames)
            self.dropped[TOO_LARGE] += len(frames) - len(fitting)
            self._frames.extend(fitting)
            excess = len(self._frames) - self._frames_limit
            for _ in range(excess):
                self._frames.popleft()
            self.dropped[QUEUE_FULL] += max(excess, 0)
            for source, count in Counter(frame.source for frame in frames).items():
                known = source in self.by_source or len(self.by_source) < SOURCES_MAX
                self.by_source[source if known else "other"] += count
            self._changed.notify()

    def wait(self, timeout_s: float) -> bool:
        """Return whether a frame waits, at the latest after the timeout."""
        with self._changed:
            return self._changed.wait_for(lambda: bool(self._frames), timeout_s)

    def take(self, frames_max: int, bytes_max: int) -> list[Frame]:
        """Return the oldest frames that fit a bundle, at least one if any waits."""
        taken: list[Frame] = []
        size = 0
        with self._changed:
            while self._frames and len(taken) < frames_max:
                size += len(self._frames[0].payload) + len(self._frames[0].source) + _OVERHEAD_BYTES
                if taken and size > bytes_max:
                    break
                taken.append(self._frames.popleft())
        return taken
