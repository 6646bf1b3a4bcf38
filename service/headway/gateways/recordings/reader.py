"""What a reader of recordings is given, and what it yields."""

import gzip
import io
import sys
import zlib
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeAlias

STANDARD_INPUT: Final = "-"
CHUNK: Final = 2_000
"""Records that a reader yields at once."""

Record: TypeAlias = dict[str, Any]
"""A BSM v1 map, not yet validated; `received_us` may say when it was received."""

_COMPRESSED: Final = (".gz", ".zst")
_GZIP: Final = b"\x1f\x8b"
_ZSTD: Final = b"\x28\xb5\x2f\xfd"


class RecordingError(Exception):
    """A recording that cannot be read: one line that names the file and the place."""


class Row(NamedTuple):
    """A record and where it stands."""

    number: int
    """Of its line or row, from 1."""
    record: Record


@dataclass(slots=True)
class Source:
    """One recording: its bytes, decompressed, and what its name says of it."""

    name: str
    ending: str
    """Of the name, less that of the compression, such as ".jsonl"; empty for standard input."""
    stream: io.BufferedReader
    path: Path | None = None
    """None for standard input."""
    compressed: bool = False
    share: Callable[[], float] = field(default=lambda: 0.0)
    """How much of it is read, 0 to 1; always 0 for standard input."""

    def error(self, what: object, number: int | None = None, unit: str = "line") -> RecordingError:
        """Return the error of one place, or of the whole."""
        place = f"{self.name}: " if number is None else f"{self.name}: {unit} {number}: "
        return RecordingError(place + str(what).partition("\n")[0])


Reader: TypeAlias = Callable[[Source], Iterator[list[Row]]]
"""Reads a recording chunk by chunk, in its own order; raises `RecordingError`."""


@contextmanager
def opened(name: str) -> Iterator[Source]:
    """Open a file, or standard input for `-`, decompressed when its first bytes say gzip or zstd.

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
    except _decompression_errors() as error:
        raise RecordingError(f"{name}: cut or damaged: {error}") from None


def _decompression_errors() -> tuple[type[Exception], ...]:
    zstandard = sys.modules.get("zstandard")
    return (EOFError, zlib.error, *([zstandard.ZstdError] if zstandard else []))


def _source(name: str, path: Path | None, raw: io.BufferedReader) -> Source:
    stream = _decompressed(name, raw.peek(4)[:4], raw)
    if not stream.peek(1):
        raise RecordingError(f"{name}: empty")
    if path is None:
        return Source(name, "", stream)
    size = path.stat().st_size
    return Source(name, _ending(path), stream, path, stream is not raw, lambda: raw.tell() / size)


def _ending(path: Path) -> str:
    endings = [ending.lower() for ending in path.suffixes]
    if endings and endings[-1] in _COMPRESSED:
        endings.pop()
    return endings[-1] if endings else ""


def _decompressed(name: str, head: bytes, raw: io.BufferedReader) -> io.BufferedReader:
    if head.startswith(_GZIP):
        return io.BufferedReader(gzip.GzipFile(fileobj=raw))
    if head == _ZSTD:
        try:
            import zstandard  # noqa: PLC0415 - an extra
        except ModuleNotFoundError:
            raise RecordingError(f"{name}: zstd needs zstandard: pip install 'headway[recordings]'") from None
        return io.BufferedReader(zstandard.ZstdDecompressor().stream_reader(raw, read_across_frames=True))
    return raw
