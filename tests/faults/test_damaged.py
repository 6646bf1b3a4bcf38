"""Damaged files of an earlier run: the service starts and judges."""

import os
import shutil
from pathlib import Path

import pytest
from e2e.serving import KEYS
from faults.harness.processes import Fleet


def halved(content: bytes) -> bytes:
    return content[: len(content) // 2]


def emptied(_content: bytes) -> bytes:
    return b""


def flipped(content: bytes) -> bytes:
    return bytes(byte ^ 0x55 for byte in content[:200]) + content[200:]


@pytest.mark.parametrize("damage", [halved, emptied, flipped])
@pytest.mark.parametrize("ending", ["nbc", "nbi"])
def test_kernel_cache(start, measured, monkeypatch, tmp_path: Path, ending: str, damage) -> None:
    start().kill()  # a fresh clone has no kernels yet
    kernels = tmp_path / "kernels"
    shutil.copytree(os.environ["NUMBA_CACHE_DIR"], kernels)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(kernels))
    [file, *_] = sorted(kernels.rglob(f"reception.pseudonym_changed*.{ending}"))
    file.write_bytes(damage(file.read_bytes()))
    service = start()
    said = [line["event"] for line in service.log()]
    measured(
        f"kernel cache: .{ending} {damage.__name__}",
        "starts" + ", compiled again" * ("starting anew" in said),
        "starts",
    )
    assert "starting anew" in said


@pytest.mark.parametrize("damage", [halved, emptied, flipped])
def test_snapshot(start, measured, tmp_path: Path, damage) -> None:
    service = start()
    with Fleet(service.endpoint, KEYS.site, cars=4, seconds=3.0) as fleet:
        fleet.sent()
    assert service.stop() == 0
    parts = sorted((tmp_path / "state").glob("*.snapshot/*.part"))
    for part in parts:
        part.write_bytes(damage(part.read_bytes()))
    service = start()
    logged = service.said("snapshot not used")
    measured(f"snapshot {damage.__name__}", f"starts, {len(parts)} parts, told: {bool(logged)}", "starts, told")
    assert logged
