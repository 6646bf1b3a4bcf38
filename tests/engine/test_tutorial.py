"""The tutorial, word by word: in a folder and an environment of its own, with headway from a clone of this source."""

import os
import shutil
import signal
import subprocess
from pathlib import Path

import httpx
import pytest
from engine.debian import ROOT
from sim.until import until
from test_docs import TUTORIAL, blocks

pytestmark = pytest.mark.engine

PUBLISHED = "'headway["
"""What the tutorial installs; here it is the clone."""
START_S = 600.0


class Shell:
    """Shells of a newcomer: a home without anything, and the commands of the environment once it is made."""

    def __init__(self, folder: Path, constraints: Path) -> None:
        self._folder = folder
        binaries = folder / "headway-env" / "bin"
        self._environment = {
            "HOME": str(folder),
            "PATH": f"{binaries}:{os.environ['PATH']}",
            "PIP_CONSTRAINT": str(constraints),
            "PIP_DISABLE_PIP_VERSION_CHECK": "1",
        }

    def run(self, script: str) -> str:
        """Run lines until one fails; return what they print."""
        done = subprocess.run(
            ["bash", "-euc", script],
            cwd=self._folder,
            env=self._environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, f"{script}\n{done.stdout[-2000:]}{done.stderr[-4000:]}"
        return done.stdout

    def start(self, line: str) -> subprocess.Popen[bytes]:
        """Run a line in a shell of its own."""
        with (self._folder / f"{line.split()[1]}.log").open("wb") as log:
            return subprocess.Popen(["bash", "-c", f"exec {line}"], cwd=self._folder, env=self._environment, stderr=log)


def answers(address: str) -> bool:
    try:
        return httpx.get(address).status_code == 200
    except httpx.TransportError:
        return False


def test_each_step_does_what_the_page_says(tmp_path: Path) -> None:
    clone = tmp_path / "clone"
    subprocess.run(["git", "clone", "--quiet", "--no-hardlinks", ROOT, clone], check=True)
    install, demo, judge, live, listing = blocks(TUTORIAL)
    make_drive, in_python = blocks(TUTORIAL, "python")
    shell = Shell(tmp_path, clone / "constraints.txt")
    assert PUBLISHED in install
    shell.run(install.replace(PUBLISHED, f"'{clone}["))
    shutil.rmtree(clone)
    report = shell.run(demo)
    assert "Faults injected and found" in report
    (tmp_path / "make_drive.py").write_text(make_drive)
    assert "1,800 records" in shell.run(judge)
    (tmp_path / "draw.py").write_text(in_python)
    assert shell.run("python draw.py") == "[('blue', 'location')]\n"
    assert (tmp_path / "blue.png").exists()
    serve, replay, dashboard = live.splitlines()
    started = [shell.start(serve)]
    try:
        until(lambda: answers("http://127.0.0.1:9464/readyz"), START_S)
        started += [shell.start(replay), shell.start(dashboard)]
        until(lambda: answers("http://127.0.0.1:8080/"))
        until(lambda: httpx.get("http://127.0.0.1:8080/history").json()["updates"], START_S)
    finally:
        for process in reversed(started):
            process.send_signal(signal.SIGINT)
            process.wait(60.0)
    assert "syn-" in shell.run(listing)
