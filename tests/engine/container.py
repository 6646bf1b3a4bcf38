"""The container engine, and the image that it builds."""

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
from engine.debian import ROOT, debian

IMAGE, BASE = "headway", "python:3.11-slim"
_BUILD_S = 3_600.0
_LIMITS = ("--ulimit=nofile=4096:4096", "--ulimit=nproc=4096:4096")
"""Engines set higher limits of their own, which only a privileged machine may."""
_CERTIFICATES = Path("/etc/ssl/certs")


def _engine() -> list[str]:
    if shutil.which("podman"):
        return ["podman", *(["--runtime=runc"] if shutil.which("runc") else [])]
    if shutil.which("docker"):
        return ["docker"]
    return pytest.skip("needs a container engine (Debian: apt-get install podman runc)")


def engine(*arguments: str, check: bool = True, timeout_s: float = 120.0) -> subprocess.CompletedProcess[str]:
    """Run the engine; a failure shows what it wrote."""
    command = [*_engine(), *arguments]
    ended = subprocess.run(command, capture_output=True, text=True, check=False, timeout=timeout_s)
    assert not check or ended.returncode == 0, f"{' '.join(command)}: {ended.stdout[-2000:]}{ended.stderr[-4000:]}"
    return ended


def inspected(kind: str, name: str) -> dict[str, Any]:
    """Return what the engine knows of an image or a container."""
    [found] = json.loads(engine(kind, "inspect", name).stdout)
    return dict(found)


def build(folder: Path) -> None:
    """Build the image; an engine that cannot pull its base takes the Debian."""
    if engine("image", "inspect", BASE, check=False).returncode and engine("pull", BASE, check=False).returncode:
        archive = folder / "base.tar"
        subprocess.run(["tar", "-C", debian(), "-cf", archive, "."], check=True)
        path = "PATH=/usr/local/bin:/usr/bin:/bin:/usr/sbin:/sbin"
        engine("import", f"--change=ENV {path}", str(archive), BASE, timeout_s=600.0)
    options = ["--network=host"]
    if _engine()[0] == "podman":
        # pip trusts what this machine trusts.
        pip = folder / "pip.conf"
        pip.write_text(f"[global]\ncert = {_CERTIFICATES}/ca-certificates.crt\n")
        mounts = {_CERTIFICATES: _CERTIFICATES, pip: Path("/etc/pip.conf")}
        options += [
            "--format=docker",
            *_LIMITS,
            *(f"--volume={source}:{target}:ro" for source, target in mounts.items()),
        ]
    # The format of docker has the health check.
    engine("build", *options, "--file", "docker/Dockerfile", "--tag", IMAGE, str(ROOT), timeout_s=_BUILD_S)


def run(name: str, *arguments: str, environment: dict[str, str], detach: bool = False) -> str:
    """Run the image as the deployments do: read-only, without capabilities; return what it wrote."""
    confined = ("--read-only", "--tmpfs=/tmp:size=256m,mode=1777", "--cap-drop=all", "--security-opt=no-new-privileges")
    settings = [f"--env={key}={value}" for key, value in environment.items()]
    how = ["--detach"] if detach else ["--rm"]
    return engine(
        "run", *how, f"--name={name}", *confined, *_LIMITS, "--network=host", *settings, IMAGE, *arguments,
        timeout_s=300.0,
    ).stdout  # fmt: skip
