"""SUMO: its programs, and the floating car data of somebody's own scenario."""

import os
import subprocess
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from headway_loadtest.sources.drive import SourceError

PREFIX: Final = "sumo:"


def simulate(config: Path, seconds: float, seed: int, fcd: Path) -> None:
    """Run a scenario and write its floating car data: degrees where its network has a projection, else metres.

    Raises
    ------
    SourceError
        There is no such file, SUMO is not installed, or it refuses the scenario.
    """
    if not config.is_file():
        raise SourceError(f"{PREFIX}{config}: no such file")
    output = ("--fcd-output", f"{fcd.resolve()}", "--fcd-output.acceleration", "true", "--fcd-output.geo", "true")
    limits = ("--end", f"{seconds}", "--seed", f"{seed}", "--precision", "4", "--precision.geo", "9")
    run_program(config.resolve().parent, "sumo", "-c", config.name, *output, *limits, "--no-step-log", "true")


def run_program(folder: Path, program: str, *options: str) -> None:
    """Run one of SUMO's programs in a folder; a failure is a SourceError with its first line."""
    spec = find_spec("sumo")
    if spec is None or not spec.submodule_search_locations:
        raise SourceError("simulated traffic needs SUMO; install headway[sumo]")
    home = Path(spec.submodule_search_locations[0])
    done = subprocess.run(  # noqa: S603 - a program of the package, options of ours
        [home / "bin" / program, *options, "--no-warnings", "true"],
        cwd=folder,
        env={**os.environ, "SUMO_HOME": str(home)},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise SourceError(f"{program}: {done.stderr.strip().partition(chr(10))[0]}")
