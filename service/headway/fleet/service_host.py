"""A service below its host: it ends whenever the host does, and the host whenever the raylet of its machine does.

The kernel ends it (`PR_SET_PDEATHSIG`), so it needs no thread that could hang. A raylet that is killed alone leaves no
service that goes on.
"""

import ctypes
import json
import os
import signal
import subprocess
import sys
from collections.abc import Mapping
from typing import Final

from headway.settings import ENV_PREFIX

_PR_SET_PDEATHSIG: Final = 1
_LIBC: Final = ctypes.CDLL(None)


def end_with_parent(parent: int | None = None) -> None:
    """Have this process killed when the thread that started it ends; `parent` is the process expected."""
    expected = os.getppid() if parent is None else parent
    _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != expected:  # it ended before
        os.kill(os.getpid(), signal.SIGKILL)


class ServiceHost:
    """Runs one service, once. It starts it in advance, up to where it needs its settings."""

    def __init__(self) -> None:
        end_with_parent()
        others = {name: value for name, value in os.environ.items() if not name.startswith(ENV_PREFIX)}
        own = os.getpid()
        self._service = subprocess.Popen(
            [sys.executable, "-m", "headway", "serve", "--standby"],
            env=others,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            preexec_fn=lambda: end_with_parent(own),  # noqa: PLW1509 - a call of the kernel, no lock
        )

    def ready(self) -> None:
        """Wait until the service has loaded all that it can without its settings, or has ended."""
        assert self._service.stdout is not None
        self._service.stdout.readline()

    def run(self, environment: Mapping[str, str]) -> int:
        """Give the service its settings and wait for its end; return its exit status."""
        assert self._service.stdin is not None
        self._service.stdin.write(json.dumps(dict(environment)) + "\n")
        self._service.stdin.close()
        return self.wait()

    def wait(self) -> int:
        """Wait for the end of the service that runs."""
        return self._service.wait()

    def stop(self) -> None:
        """Let the service stop in order."""
        self._service.send_signal(signal.SIGTERM)
