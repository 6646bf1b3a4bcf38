"""Which reader reads a recording: by the name of the format, the ending of the file, or its first byte."""

import heapq
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import islice
from typing import Final, NamedTuple

from headway.gateways.recordings.bsm_lines import read_lines
from headway.gateways.recordings.columns import RECEIVED, read_csv, read_parquet
from headway.gateways.recordings.reader import CHUNK, Reader, Record, RecordingError, Source, named_errors, opened

AUTO: Final = "auto"


@dataclass(frozen=True, slots=True)
class Format:
    """A kind of recordings. A new one is a reader and an entry of `FORMATS`."""

    readers: Mapping[str, Reader]
    """By ending of the file."""
    from_stream: Callable[[bytes], Reader | None] = lambda _: None
    """Returns the reader of a stream without a name that begins with these bytes; None: it is of another format."""


_BSM_READERS: Final = {".jsonl": read_lines, ".ndjson": read_lines, ".csv": read_csv, ".parquet": read_parquet}
FORMATS: Final[Mapping[str, Format]] = {
    "bsm": Format(_BSM_READERS, lambda head: read_lines if head.lstrip()[:1] == b"{" else read_csv),
}


class Located(NamedTuple):
    """A record and its place in words."""

    source: Source
    number: int
    record: Record


@dataclass(frozen=True, slots=True)
class Recordings:
    """Open recordings, read as one."""

    sources: Sequence[Source]
    chunks: Iterator[list[Located]]
    """By time of reception, if each recording is: of two records the earlier one comes first."""

    @property
    def share(self) -> float:
        """How much is read, 0 to 1."""
        return sum(source.share() for source in self.sources) / len(self.sources)


@contextmanager
def open_recordings(names: Sequence[str], form: str = AUTO) -> Iterator[Recordings]:
    """Open recordings of one format, or each of the format that its name or its first bytes tell.

    Raises
    ------
    RecordingError
        One of them cannot be read; also while the chunks are read.
    """
    if form != AUTO and form not in FORMATS:
        raise RecordingError(f"--format {form}: choose from {', '.join((AUTO, *FORMATS))}")
    with ExitStack() as stack:
        sources = [stack.enter_context(opened(name)) for name in names]
        readers = [_reader(source, form) for source in sources]
        located = [_located(source, reader) for source, reader in zip(sources, readers, strict=True)]
        yield Recordings(sources, located[0] if len(located) == 1 else _merged(located))


def _reader(source: Source, form: str) -> Reader:
    formats = FORMATS.values() if form == AUTO else [FORMATS[form]]
    for candidate in formats:
        reader = (
            candidate.readers.get(source.ending)
            if source.path is not None
            else candidate.from_stream(source.stream.peek(64))
        )
        if reader is not None:
            return reader
    endings = ", ".join(ending for candidate in formats for ending in candidate.readers)
    raise source.error(f"no recording by its ending: {endings}, each also with .gz or .zst")


def _located(source: Source, reader: Reader) -> Iterator[list[Located]]:
    empty = True
    with named_errors(source.name):
        for rows in reader(source):
            empty = False
            yield [Located(source, *row) for row in rows]
    if empty:
        raise source.error("no records")


def _merged(recordings: Sequence[Iterator[list[Located]]]) -> Iterator[list[Located]]:
    merged = heapq.merge(*map(_timed, recordings), key=lambda timed: timed[0])
    while chunk := [located for _, located in islice(merged, CHUNK)]:
        yield chunk


def _timed(chunks: Iterator[list[Located]]) -> Iterator[tuple[int, Located]]:
    """Yield each record with the newest time of reception so far in its recording."""
    newest_us = 0
    for chunk in chunks:
        for located in chunk:
            received_us = located.record.get(RECEIVED)
            if received_us is None:
                received_us = located.record.get("t_us")
            if type(received_us) is int:
                newest_us = max(newest_us, received_us)
            yield newest_us, located
