"""Processes that start together compile one after the other."""

import json
import pickle
import shutil
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from headway import kernel_cache

SOON_S, NEVER_S = 10.0, 0.2


@pytest.fixture
def folder(tmp_path, monkeypatch):
    folder = tmp_path / "not" / "yet"
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(folder))
    return folder


def test_a_second_waits_until_the_first_has_compiled(folder) -> None:
    entered = threading.Event()

    def second() -> None:
        with kernel_cache.alone():
            entered.set()

    waiting = threading.Thread(target=second, daemon=True)
    with kernel_cache.alone():
        waiting.start()
        assert not entered.wait(NEVER_S)
    assert entered.wait(SOON_S)
    waiting.join(SOON_S)


def test_what_goes_wrong_inside_lets_the_next_one_in(folder) -> None:
    with pytest.raises(RuntimeError), kernel_cache.alone():
        raise RuntimeError
    with kernel_cache.alone():
        assert (folder / kernel_cache.LOCK).exists()


def test_kernels_are_counted_wherever_they_lie(folder) -> None:
    assert kernel_cache.kept() == 0
    (folder / "core").mkdir(parents=True)
    for name in ("one.1.nbc", "one.2.nbc", "one.nbi"):
        (folder / "core" / name).touch()
    assert kernel_cache.kept() == 2


@pytest.mark.parametrize("is_noted", [True, False])
@pytest.mark.parametrize("damage", [lambda whole: whole[: len(whole) // 2], lambda _: b""])
def test_a_file_that_is_cut_short_is_removed(folder, damage, is_noted: bool) -> None:
    folder.mkdir(parents=True)
    for name in ("one-1.py311.1.nbc", "two-1.py311.1.nbc"):
        (folder / name).write_bytes(pickle.dumps(list(range(100))))
    if is_noted:
        with kernel_cache.alone():
            pass
    (folder / "one-1.py311.1.nbc").write_bytes(damage((folder / "one-1.py311.1.nbc").read_bytes()))
    with kernel_cache.alone():
        assert [file.name for file in sorted(folder.glob("*.nbc"))] == ["two-1.py311.1.nbc"]


def test_a_noted_file_with_one_wrong_bit_is_removed(folder) -> None:
    folder.mkdir(parents=True)
    (folder / "one-1.py311.1.nbc").write_bytes(pickle.dumps(b"machine code"))
    with kernel_cache.alone():
        pass
    (folder / "one-1.py311.1.nbc").write_bytes(pickle.dumps(b"machine c0de"))
    with kernel_cache.alone():
        assert kernel_cache.kept() == 0


@pytest.mark.parametrize("content", [b"", b"[1]", b"\xff{"])
def test_damaged_checksums_are_made_again(folder, content: bytes) -> None:
    folder.mkdir(parents=True)
    (folder / "one-1.py311.1.nbc").write_bytes(pickle.dumps(b"machine code"))
    (folder / kernel_cache.CHECKSUMS).write_bytes(content)
    with kernel_cache.alone():
        assert kernel_cache.kept() == 1
    assert list(json.loads((folder / kernel_cache.CHECKSUMS).read_bytes())) == ["one-1.py311.1.nbc"]


def test_a_folder_that_cannot_be_made_stops_nobody(tmp_path, monkeypatch) -> None:
    (tmp_path / "file").write_bytes(b"")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file" / "kernels"))
    ran = False
    with kernel_cache.alone():
        ran = True
    assert ran


def test_touching_any_file_below_core_changes_the_digests(tmp_path) -> None:
    package = tmp_path / "headway"
    here = Path(kernel_cache.__file__).parent
    for part in ("core", "edge/codec", "feeds"):
        shutil.copytree(here / part, package / part, ignore=shutil.ignore_patterns("__pycache__"))
    assert kernel_cache.core_digest(package) == kernel_cache.core_digest()
    for source in sorted((package / "core").rglob("*.py")):
        before = kernel_cache.core_digest(package), kernel_cache.kernels_digest(package)
        source.write_bytes(source.read_bytes() + b"# touched\n")
        after = kernel_cache.core_digest(package), kernel_cache.kernels_digest(package)
        assert before[0] != after[0]
        assert before[1] != after[1]


def test_every_module_with_a_kernel_is_in_the_digest() -> None:
    here = Path(kernel_cache.__file__).parent
    with_kernels = {p.relative_to(here) for p in here.rglob("*.py") if "@njit" in p.read_text(encoding="utf-8")}
    beside = {Path("edge/codec/msgpack_columns.py"), Path("feeds/uper_kernel.py")}
    assert {p for p in with_kernels if p.parts[0] != "core"} == beside


LATER = """
import sys
from headway import kernel_cache
kernel_cache.without_blas()
from numba import njit
from headway.core.tracking.geodesy import metres_per_degree

@njit
def through(lat_deg):
    return metres_per_degree(lat_deg)

before = metres_per_degree(48.0)
kernel_cache.release_bitcode()
assert through(48.0) == before
assert [name for name, module in sys.modules.items() if name.startswith("scipy.linalg") and module] == []
"""


def test_a_kernel_compiled_after_the_release_of_bitcode_calls_those_before_and_blas_is_not_loaded() -> None:
    subprocess.run([sys.executable, "-c", LATER], check=True)
