"""Every package that serving needs has a wheel for both architectures, so a small box compiles nothing."""

import subprocess
import sys
from pathlib import Path

import pytest
from engine.debian import ROOT
from test_dependencies import required

pytestmark = pytest.mark.engine


def pinned() -> list[str]:
    """Return the pins of what `pip install headway` brings."""
    pins = [line for line in (ROOT / "constraints.txt").read_text().splitlines() if "==" in line]
    needed = required()
    return [pin for pin in pins if pin.partition("==")[0].lower().replace("_", "-") in needed]


@pytest.mark.parametrize("architecture", ["x86_64", "aarch64"])
def test_each_package_has_a_wheel(architecture: str, tmp_path: Path) -> None:
    platforms = [f"--platform=manylinux{version}_{architecture}" for version in ("2014", "_2_27", "_2_28")]
    report = subprocess.run(
        [sys.executable, "-m", "pip", "install", "--dry-run", "--ignore-installed", "--no-deps", "--only-binary=:all:",
         "--python-version=3.11", *platforms, f"--target={tmp_path}", *pinned()],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert report.returncode == 0, report.stderr
    assert len(pinned()) > 15
