"""A recording that goes on without an end of its line, row or element takes no more memory than one that has them."""

import io
import tracemalloc
from collections.abc import Callable, Iterator
from itertools import chain
from pathlib import Path

import pytest
from gateways.recordings.made_files import MADE

from headway.feeds.refusal import MALFORMED
from headway.gateways.recordings.columns import read_csv
from headway.gateways.recordings.formats import FORMATS
from headway.gateways.recordings.reader import RecordingError, Row, Source

ENDLESS_BYTES, PEAK_BYTES = 40_000_000, 15_000_000
BSM_CSV = b"id,msg_cnt,t_us,lat,lon,speed_mps\na,1,1700000000000000,42.3,-83.7,13.5\n"


class Endless(io.RawIOBase):
    """Bytes, and then the same over and over."""

    def __init__(self, head: bytes, repeated: bytes, size: int) -> None:
        self._parts = chain([head], iter(lambda: repeated * (8_000 // len(repeated)), b""))
        self._left = size
        self._rest = b""

    def readable(self) -> bool:
        return True

    def readinto(self, buffer) -> int:
        self._rest = self._rest or next(self._parts)
        size = min(len(buffer), len(self._rest), self._left)
        buffer[:size], self._rest = self._rest[:size], self._rest[size:]
        self._left -= size
        return size


def read_all(
    read: Callable[[Source], Iterator[Row]], head: bytes, repeated: bytes, size: int = ENDLESS_BYTES
) -> tuple[list[Row], int]:
    """Return the first rows, and the most memory that was in use at once."""
    source = Source("a", "", io.BufferedReader(Endless(head, repeated, size)), head=head)
    tracemalloc.start()
    try:
        rows = []
        for row in read(source):
            rows += [row] if len(rows) < 1_000 else []
        return rows, tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    ("name", "word"),
    [("ode.json", "ode"), ("thea.csv", "thea"), ("vanetza.json", "cam"), ("veremi.json", "veremi")],
)
def test_messages_without_an_end(tmp_path: Path, name: str, word: str) -> None:
    MADE[name].write(tmp_path / name)
    rows, peak = read_all(FORMATS[word].read, (tmp_path / name).read_bytes(), b"[a")
    assert sum(row.refusal is None for row in rows) >= 100
    assert peak < PEAK_BYTES


@pytest.mark.parametrize("repeated", [b"a", b",", b'"', b'"a,'])
@pytest.mark.parametrize(("name", "word"), [("bsmp1.csv", "bsmp1"), ("openacc.csv", "openacc")])
def test_a_row_without_an_end_is_refused(tmp_path: Path, name: str, word: str, repeated: bytes) -> None:
    MADE[name].write(tmp_path / name)
    rows, peak = read_all(FORMATS[word].read, (tmp_path / name).read_bytes(), repeated)
    assert sum(row.refusal is None for row in rows) >= 120
    assert {row.refusal.reason for row in rows if row.refusal} == {MALFORMED}
    assert peak < PEAK_BYTES


def test_a_row_of_many_lines_ends_and_the_rows_behind_it_are_read(tmp_path: Path) -> None:
    MADE["bsmp1.csv"].write(tmp_path / "a.csv")
    header, first, *others = (tmp_path / "a.csv").read_bytes().splitlines(keepends=True)
    content = b"".join([header, first, b'"a\n",' * 300_000, b'"\n', *others])
    source = Source("a", "", io.BufferedReader(io.BytesIO(content)), head=content[:65_536])
    rows = list(FORMATS["bsmp1"].read(source))
    assert sum(row.refusal is None for row in rows) == 1 + len(others)


@pytest.mark.parametrize("repeated", [b"a", b",", b'"a\n",'])
def test_a_row_of_bsm_without_an_end_is_named(repeated: bytes) -> None:
    with pytest.raises(RecordingError, match=r"line \d+: a row longer than 1,000,000 characters"):
        read_all(lambda source: chain.from_iterable(read_csv(source)), BSM_CSV, repeated)


@pytest.mark.parametrize(
    ("begin", "repeated"),
    [
        (b"", b"a"), (b"<!--", b"a"), (b"<a", b"a"), (b'<a b="', b"a"), (b"", b"<a>"), (b"", b"<!--a-->"),
    ],
)  # fmt: skip
def test_an_element_without_an_end_ends_the_file(tmp_path: Path, begin: bytes, repeated: bytes) -> None:
    MADE["fcd-geo.xml"].write(tmp_path / "a.xml")
    head = (tmp_path / "a.xml").read_bytes().replace(b"</fcd-export>", b"").rstrip() + begin
    rows, peak = read_all(FORMATS["fcd"].read, head, repeated)
    assert sum(row.refusal is None for row in rows) == 120
    assert [row.refusal.detail for row in rows if row.refusal] == ["the XML is cut or damaged: it ends here"]
    assert peak < PEAK_BYTES


def test_elements_are_released_wherever_they_are(tmp_path: Path) -> None:
    MADE["fcd-geo.xml"].write(tmp_path / "a.xml")
    head = (tmp_path / "a.xml").read_bytes().replace(b"</fcd-export>", b"").rstrip() + b'<timestep time="9">'
    rows, peak = read_all(FORMATS["fcd"].read, head, b"<b/>", 1_000_000)
    assert len(rows) == 121
    assert peak < PEAK_BYTES / 2
