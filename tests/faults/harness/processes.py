"""Senders, subscribers and routers as processes that can be stopped, continued and killed."""

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Self

HERE = Path(__file__).parent
ENVIRONMENT_FILE = HERE.parents[2] / "deploy" / "zenoh" / "router.env"


class Process:
    """A script of this folder; what it prints is collected as it comes."""

    def __init__(
        self,
        script: str,
        arguments: Sequence[str],
        *,
        inside: Sequence[str] = (),
        environment: Mapping[str, str] | None = None,
    ) -> None:
        self.popen = subprocess.Popen(
            [*inside, sys.executable, str(HERE / script), *arguments],
            env=os.environ | (environment or {}),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            bufsize=1,
        )
        self._lines: list[str] = []
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        assert self.popen.stdout is not None
        for line in self.popen.stdout:
            self._lines.append(line)

    @property
    def lines(self) -> list[str]:
        """What it printed so far."""
        return list(self._lines)

    def freeze(self) -> None:
        """Stop it as a hung process is."""
        self.popen.send_signal(signal.SIGSTOP)

    def thaw(self) -> None:
        """Let it go on."""
        self.popen.send_signal(signal.SIGCONT)

    def wait(self, timeout_s: float) -> list[str]:
        """Wait until it has ended by itself; return all that it printed."""
        self.popen.wait(timeout_s)
        self._thread.join(timeout_s)
        return self.lines

    def kill(self) -> None:
        """End it at once."""
        self.popen.kill()
        self.popen.wait(10.0)
        self._thread.join(10.0)
        for pipe in (self.popen.stdin, self.popen.stdout):
            assert pipe is not None
            pipe.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.kill()


class Fleet(Process):
    """Cars that drive in pairs (`fleet_process`)."""

    def __init__(self, endpoint: str, site: str, *, cars: int, seconds: float, **options: float | str) -> None:
        more = [word for name, value in options.items() for word in (f"--{name.replace('_', '-')}", str(value))]
        arguments = ["--endpoint", endpoint, "--site", site, "--cars", str(cars), "--seconds", str(seconds), *more]
        super().__init__("fleet_process.py", arguments)
        self._seconds = seconds

    def sent(self) -> dict[str, int]:
        """Wait for the end; return how many messages each car sent."""
        return json.loads(self.wait(self._seconds + 60.0)[-1])


class Subscriber(Process):
    """A subscriber of alerts (`subscriber_process`).

    With `stall_after` it takes no more after so many. With `catch_up` it asks the history for what it missed. It runs
    `inside` a network.
    """

    def __init__(
        self,
        endpoint: str,
        site: str,
        *,
        stall_after: int | None = None,
        catch_up: bool = False,
        inside: Sequence[str] = (),
    ) -> None:
        more = [] if stall_after is None else ["--stall-after", str(stall_after)]
        more += ["--catch-up"] if catch_up else []
        super().__init__("subscriber_process.py", ["--endpoint", endpoint, "--site", site, *more], inside=inside)

    @property
    def ready(self) -> bool:
        """Whether it has subscribed."""
        return bool(self._lines)

    @property
    def alerts(self) -> list[dict]:
        """Alerts so far, each with `received_us`, without evidence."""
        return [json.loads(line) for line in self.lines[1:]]


class Flood(Process):
    """One sender at full speed (`flood_process`)."""

    def __init__(self, endpoint: str, site: str, *, seconds: float, payload_bytes: int = 0) -> None:
        arguments = ["--endpoint", endpoint, "--site", site, "--seconds", str(seconds)]
        super().__init__("flood_process.py", [*arguments, "--payload-bytes", str(payload_bytes)])
        self._seconds = seconds

    def sent(self) -> int:
        """Wait for the end; return how many messages it sent."""
        return int(self.wait(self._seconds + 60.0)[-1])


class Router(Process):
    """A router with a configuration file (`router_process`), in the environment that the files deploy."""

    def __init__(self, endpoint: str, file: Path) -> None:
        self.endpoint = endpoint
        lines = ENVIRONMENT_FILE.read_text(encoding="utf-8").splitlines()
        environment = dict(line.split("=", 1) for line in lines if not line.startswith("#"))
        super().__init__("router_process.py", [endpoint, str(file)], environment=environment)

    @property
    def ready(self) -> bool:
        """Whether it listens."""
        return bool(self._lines)
