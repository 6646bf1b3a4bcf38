"""Waiting for other threads and processes without a fixed sleep."""

import time
from collections.abc import Callable

DEADLINE_S = 30.0


def until(holds: Callable[[], object], deadline_s: float = DEADLINE_S) -> None:
    """Return as soon as `holds` is true; fail when it is not in time."""
    give_up = time.monotonic() + deadline_s
    while not holds():
        assert time.monotonic() < give_up, "not in time"
        time.sleep(0.005)
