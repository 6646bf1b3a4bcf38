"""What a reader of recordings is given, and what it yields."""

import bz2
import gzip
import io
import lzma
import sys
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeAlias, cast

from headway.feeds.refusal import Refusal
from headway.gateways.recordings.parquet import ParquetError, opened_table

STANDARD_INPUT: Final = "-"
PARQUET: Final = b"PAR1"
BOM: Final = b"\xef\xbb\xbf"
CHUNK: Final = 2_000
"""Records that a reader yields at once."""
START_US: Final = 946_684_800_000_000
"""Unix time, 2000-01-01, that stands for 0 in recordings whose time counts from their own start."""

Record: TypeAlias = dict[str, Any]
"""A BSM v1 map, not yet validated; `received_us` may say when it was received."""

_COMPRESSED: Final = (".gz", ".zst", ".zip", ".bz2", ".xz")
_STANDARD: Final[dict[bytes, Callable[[Any], Any]]] = {
    b"\x1f\x8b": lambda raw: gzip.GzipFile(fileobj=raw), b"BZh": bz2.BZ2File, b"\xfd7zX": lzma.LZMAFile,
}  # fmt: skip
"""What the standard library decompresses, by the first bytes."""
_ZSTD: Final = b"\x28\xb5\x2f\xfd"
_ZIP: Final = (b"PK\x03\x04", b"PK\x05\x06")
"""An archive with files, and an empty one."""
_UTF_16: Final = (b"\xff\xfe", b"\xfe\xff")
_HEAD_BYTES: Final = 65_536


class RecordingError(Exception):
    """A recording that cannot be read: one line that names the file and the place."""

    def __init__(self, text: str) -> None:
        # Names of columns are what the file says, so they may hold what a terminal obeys.
        super().__init__("".join(letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in text))


class Truth(NamedTuple):
    """What the ground truth of a data set says of a message. The detector never sees it."""

    message: str
    is_attack: bool | None
    """None: another row tells it."""


class Row(NamedTuple):
    """A record and where it stands."""

    number: int
    """Of its line or row, from 1."""
    record: Record
    """Empty where the row is refused, and where it is ground truth only."""
    drive: str = ""
    """Records of two drives never meet on the road."""
    refusal: Refusal | None = None
    truth: Truth | None = None


@dataclass(slots=True)
class Source:
    """One recording: its bytes, decompressed, and what its name says of it."""

    name: str
    ending: str
    """Of the name, less that of the compression, such as ".jsonl"; empty for standard input."""
    stream: "io.BufferedReader[Any]"
    path: Path | None = None
    """None for standard input."""
    share: Callable[[], float] = field(default=lambda: 0.0)
    """How much of it is read, 0 to 1; always 0 for standard input."""
    head: bytes = b""
    """Its first bytes; of a Parquet file the names of its columns as a line of CSV."""
    columns: str | None = None
    """The mapping that the user gives for a table."""

    def error(self, what: object, number: int | None = None, unit: str = "line") -> RecordingError:
        """Return the error of one place, or of the whole."""
        place = f"{self.name}: " if number is None else f"{self.name}: {unit} {number}: "
        return RecordingError(place + str(what).partition("\n")[0])


Reader: TypeAlias = Callable[[Source], Iterator[list[Row]]]
"""Reads a recording chunk by chunk, in its own order; raises `RecordingError`."""


class _Rewound(io.RawIOBase):
    """A stream whose first bytes have been read, from its beginning."""

    def __init__(self, head: bytes, rest: io.BufferedIOBase) -> None:
        self._head = memoryview(head)
        self._rest = rest

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        if not self._head:
            return self._rest.readinto(buffer)
        size = min(len(buffer), len(self._head))
        buffer[:size], self._head = self._head[:size], self._head[size:]
        return size


@contextmanager
def opened(name: str) -> Iterator[Source]:
    """Open a file, or standard input for `-`, decompressed when its first bytes say that it is compressed.

    Raises
    ------
    RecordingError
        It is missing, a folder, empty, or cannot be read.
    """
    path, name = (None, "standard input") if name == STANDARD_INPUT else (Path(name), name)
    with ExitStack() as stack:
        with named_errors(name):
            source = _source(name, path, stack.enter_context(_open(path)))
        yield source


def _open(path: Path | None) -> io.BufferedReader:
    return path.open("rb") if path is not None else io.BufferedReader(io.FileIO(sys.stdin.fileno(), closefd=False))


@contextmanager
def named_errors(name: str) -> Iterator[None]:
    """Turn what may go wrong while a recording is read into a `RecordingError`."""
    try:
        yield
    except OSError as error:
        raise RecordingError(f"{name}: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise RecordingError(f"{name}: not UTF-8 text") from None
    except MemoryError:
        raise RecordingError(f"{name}: takes too much memory") from None
    except ParquetError as error:
        raise RecordingError(f"{name}: {error}") from None
    except _decompression_errors() as error:
        raise RecordingError(f"{name}: cut or damaged: {error}") from None


def _decompression_errors() -> tuple[type[Exception], ...]:
    zstandard = sys.modules.get("zstandard")
    return (EOFError, zlib.error, lzma.LZMAError, zipfile.BadZipFile, *([zstandard.ZstdError] if zstandard else []))


def _source(name: str, path: Path | None, raw: io.BufferedReader) -> Source:
    stream, inner = _decompressed(name, path, raw)
    head = stream.read(_HEAD_BYTES)
    if not head:
        raise RecordingError(f"{name}: empty")
    if head.startswith(_UTF_16):
        raise RecordingError(f"{name}: text in UTF-16: save it as UTF-8")
    if head.startswith(PARQUET) and (path is None or stream is not raw):
        raise RecordingError(f"{name}: Parquet is read from an uncompressed file only")
    rewound = io.BufferedReader(_Rewound(head, stream), _HEAD_BYTES)
    if path is None:
        return Source(name, "", rewound, head=head)
    size = path.stat().st_size
    ending = _ending(path) if inner is None else _ending(Path(inner))
    source = Source(name, ending, rewound, path, lambda: min(raw.tell() / size, 1.0), head)
    if head.startswith(PARQUET):
        with opened_table(path) as table:
            source.head = ",".join(column.name for column in table.columns).encode()
    return source


def _ending(path: Path) -> str:
    endings = [ending.lower() for ending in path.suffixes]
    if endings and endings[-1] in _COMPRESSED:
        endings.pop()
    return endings[-1] if endings else ""


def _decompressed(name: str, path: Path | None, raw: io.BufferedReader) -> tuple[io.BufferedReader, str | None]:
    """Return the decompressed stream, and the name of the file within an archive."""
    head = raw.peek(4)[:4]
    for signature, decompressed in _STANDARD.items():
        if head.startswith(signature):
            return io.BufferedReader(decompressed(raw)), None
    if head == _ZSTD:
        try:
            import zstandard  # noqa: PLC0415 - an extra
        except ModuleNotFoundError:
            raise RecordingError(f"{name}: zstd needs zstandard: pip install 'headway[recordings]'") from None
        return io.BufferedReader(zstandard.ZstdDecompressor().stream_reader(raw, read_across_frames=True)), None
    if head in _ZIP:
        return _unzipped(name, path, raw)
    return raw, None


def _unzipped(name: str, path: Path | None, raw: io.BufferedReader) -> tuple[io.BufferedReader, str]:
    if path is None:
        raise RecordingError(f"{name}: a zip archive is read from a file only")
    try:
        archive = zipfile.ZipFile(raw)
        members = [
            member
            for member in archive.infolist()
            if not member.filename.endswith("/") and "__MACOSX" not in member.filename
        ]
        if len(members) != 1:
            raise RecordingError(f"{name}: {len(members)} files in the archive: unpack it, and name those to be read")
        return io.BufferedReader(cast("io.RawIOBase", archive.open(members[0]))), members[0].filename
    except (RuntimeError, NotImplementedError) as error:
        raise RecordingError(f"{name}: {error}") from None
