"""Pages of a file that is mapped into this process."""

import mmap
import re
from pathlib import Path

import pytest

from headway.edge.telemetry.process import release_pages

pytestmark = pytest.mark.skipif(not Path("/proc/self/smaps").exists(), reason="needs Linux")
SIZE = 1 << 20


def resident_kb(name: str) -> list[int]:
    """Return the resident size of each mapping of a file."""
    text = Path("/proc/self/smaps").read_text()
    return [
        int(size)
        for path, size in re.findall(r"(\S+)\nSize:.*?\nRss: +(\d+) kB", text, re.DOTALL)
        if path.endswith(name)
    ]


@pytest.fixture
def content(tmp_path: Path) -> bytes:
    content = bytes(range(256)) * (SIZE // 256)
    (tmp_path / "libsample.so").write_bytes(content)
    return content


def test_pages_that_were_read_are_released_and_read_again(tmp_path: Path, content: bytes) -> None:
    with (
        (tmp_path / "libsample.so").open("rb") as file,
        mmap.mmap(file.fileno(), 0, mmap.MAP_PRIVATE, mmap.PROT_READ) as map_,
    ):
        assert map_[:] == content
        assert resident_kb("libsample.so") == [SIZE // 1024]
        release_pages()
        assert resident_kb("libsample.so") == [0]
        assert map_[:] == content


def test_pages_that_were_changed_stay(tmp_path: Path, content: bytes) -> None:
    access = mmap.PROT_READ | mmap.PROT_WRITE
    with (tmp_path / "libsample.so").open("r+b") as file, mmap.mmap(file.fileno(), 0, mmap.MAP_PRIVATE, access) as map_:
        map_[:4] = b"mine"
        release_pages()
        assert map_[:] == b"mine" + content[4:]
