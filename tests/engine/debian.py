"""A Debian with Python and systemd in a folder, for an engine that reaches no registry, and for systemd."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
_PACKAGES = "ca-certificates,dbus,python-is-python3,python3,python3-venv,systemd,systemd-sysv"


def debian() -> Path:
    """Return the folder, which is made once; skip where it cannot be made."""
    tree = ROOT / "build" / "debian"
    if not (tree / "usr/bin/python").exists():
        if shutil.which("debootstrap") is None or os.geteuid() != 0:
            pytest.skip("needs root and debootstrap (Debian: apt-get install debootstrap)")
        shutil.rmtree(tree, ignore_errors=True)
        make = ["debootstrap", "--variant=minbase", f"--include={_PACKAGES}", "bookworm", str(tree)]
        subprocess.run(make, check=True, timeout=1_800)
        shutil.rmtree(tree / "var/cache/apt/archives")
    return tree
