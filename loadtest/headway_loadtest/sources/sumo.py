"""SUMO: its programs, and a scenario of somebody's own, coupled by TraCI."""

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from importlib import import_module
from importlib.util import find_spec
from io import StringIO
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, Any, Final

from headway_loadtest.sources.drive import SourceError

PREFIX: Final = "sumo:"
_RETRIES: Final = 300
_RETRY_S: Final = 0.1
"""SUMO loads its network before it answers."""
_STOP_S: Final = 5.0


@contextmanager
def coupled(config: Path, seed: int) -> Iterator[Any]:
    """Start SUMO with a scenario and give its TraCI connection; SUMO ends with the context.

    Raises
    ------
    SourceError
        There is no such file, SUMO is not installed, or it refuses the scenario.
    """
    if not config.is_file():
        raise SourceError(f"{PREFIX}{config}: no such file")
    home = _home()
    if f"{home / 'tools'}" not in sys.path:
        sys.path.append(f"{home / 'tools'}")
    traci = import_module("traci")
    port = _free_port()
    options = ("-c", config.name, "--remote-port", f"{port}", "--seed", f"{seed}", "--no-step-log", "true")
    with TemporaryFile() as said:
        process = _start(home, config.resolve().parent, ("sumo", *options), said)
        try:
            with redirect_stdout(StringIO()):  # it prints each attempt
                connection = traci.connect(port, _RETRIES, "127.0.0.1", process, _RETRY_S)
        except (traci.TraCIException, traci.FatalTraCIError):
            process.kill()
            process.wait()
            raise SourceError(f"sumo: {_first_line(said)}") from None
        try:
            yield connection
        except (traci.TraCIException, traci.FatalTraCIError) as error:
            raise SourceError(f"sumo: {_first_line(said) or error}") from None
        finally:
            connection.close(wait=False)
            try:
                process.wait(_STOP_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def run_program(folder: Path, program: str, *options: str) -> None:
    """Run one of SUMO's programs in a folder; a failure is a SourceError with its first line."""
    with TemporaryFile() as said:
        if _start(_home(), folder, (program, *options), said).wait():
            raise SourceError(f"{program}: {_first_line(said)}")


def _home() -> Path:
    spec = find_spec("sumo")
    if spec is None or not spec.submodule_search_locations:
        raise SourceError("simulated traffic needs SUMO; install headway[sumo]")
    return Path(spec.submodule_search_locations[0])


def _start(home: Path, folder: Path, command: tuple[str, ...], said: IO[bytes]) -> "subprocess.Popen[bytes]":
    program, *options = command
    return subprocess.Popen(  # noqa: S603 - a program of the package, options of ours
        [home / "bin" / program, *options, "--no-warnings", "true"],
        cwd=folder,
        env={**os.environ, "SUMO_HOME": str(home)},
        stdout=subprocess.DEVNULL,
        stderr=said,
    )


def _first_line(said: IO[bytes]) -> str:
    said.seek(0)
    return said.read(4_096).decode("utf-8", "replace").strip().partition("\n")[0]


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port: int = server.getsockname()[1]
    return port
