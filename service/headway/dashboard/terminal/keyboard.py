"""Single keys from the terminal, without waiting for Enter."""

import os
import select
import sys
import termios
import time
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TextIO


class Keyboard:
    """Reads keys from a terminal that sends each at once."""

    def __init__(self, terminal: TextIO | None) -> None:
        self._terminal = terminal

    def pressed(self, within_s: float) -> str:
        """Return the next key, or an empty text after `within_s` seconds."""
        if self._terminal is None:
            time.sleep(within_s)
            return ""
        ready, _, _ = select.select([self._terminal], [], [], within_s)
        return os.read(self._terminal.fileno(), 1).decode(errors="ignore") if ready else ""


@contextmanager
def keyboard(terminal: TextIO = sys.stdin) -> Iterator[Keyboard]:
    """Open the keyboard, and leave the terminal as it was; without a terminal there are no keys."""
    if not terminal.isatty():
        yield Keyboard(None)
        return
    before = termios.tcgetattr(terminal)
    try:
        tty.setcbreak(terminal)
        yield Keyboard(terminal)
    finally:
        termios.tcsetattr(terminal, termios.TCSADRAIN, before)
