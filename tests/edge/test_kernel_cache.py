"""Processes that start together compile one after the other."""

import threading

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


def test_a_folder_that_cannot_be_made_stops_nobody(tmp_path, monkeypatch) -> None:
    (tmp_path / "file").write_bytes(b"")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file" / "kernels"))
    ran = False
    with kernel_cache.alone():
        ran = True
    assert ran
