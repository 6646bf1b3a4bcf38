"""Which reader reads a recording: by the name of the format, else by its first bytes, else by its ending."""

import heapq
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Final, NamedTuple

from headway.feeds.refusal import Refusal
from headway.gateways.recordings import fcd
from headway.gateways.recordings.bsm_lines import read_lines
from headway.gateways.recordings.columns import RECEIVED, read_csv, read_parquet
from headway.gateways.recordings.messages import cam, ode, pcap, thea, veremi
from headway.gateways.recordings.order import by_drive
from headway.gateways.recordings.reader import (
    BOM,
    CHUNK,
    PARQUET,
    STANDARD_INPUT,
    Reader,
    Record,
    RecordingError,
    Row,
    Source,
    Truth,
    named_errors,
    opened,
)
from headway.gateways.recordings.tables import openacc, published
from headway.gateways.recordings.tables.cells import header_of

AUTO: Final = "auto"
BSM: Final = "bsm"
COLUMNS: Final = "columns"

Rows = Callable[[Source], Iterator[Row]]


@dataclass(frozen=True, slots=True)
class Format:
    """A kind of recordings. A new one is a file with these two functions and an entry of `FORMATS`."""

    what: str
    """In a few words, for the table of formats."""
    recognise: Callable[[bytes], bool]
    """Whether a recording that begins with these bytes is of this format."""
    read: Rows
    """Yields the rows in time order, those that it refuses among them; raises `RecordingError`."""


def _table(table: published.Table, what: str) -> Format:
    return Format(what, table.recognise, table.read)


def _messages(what: str, recognise: Callable[[bytes], bool], read: Rows) -> Format:
    """Return a format whose messages all share a road, as long as no long gap is between them."""
    return Format(what, recognise, lambda source: by_drive(read(source)))


FORMATS: Final[Mapping[str, Format]] = {
    "pcap": _messages(
        "captured UDP datagrams with J2735 or CAM, UPER or JSON: pcap, pcapng", pcap.recognise, pcap.read
    ),
    "fcd": Format("SUMO floating car data, XML", fcd.recognise, fcd.read),
    "thea": _messages("Tampa pilot (THEA) CSV with XER", thea.recognise, thea.read),
    "veremi": Format("VeReMi, F2MD and VeReMi-NextGen logs, JSON", veremi.recognise, veremi.read),
    "cam": _messages("ETSI CAM in JSON of vanetza-nap or its-client", cam.recognise, cam.read),
    "ode": _messages("USDOT ODE JSON, every schema, and J2735 JSON", ode.recognise, ode.read),
    "bsmp1": _table(published.BSM_P1, "SPMD BsmP1, CSV with or without a header"),
    "datawsu": _table(published.DATA_WSU, "SPMD DataWsu, CSV"),
    "wydot": _table(published.WYDOT, "Wyoming pilot (WYDOT) BSM CSV"),
    "ngsim": _table(published.NGSIM, "NGSIM trajectories, CSV"),
    "highd": _table(published.HIGHD, "highD tracks, CSV"),
    "openacc": Format("OpenACC platoons, CSV", openacc.recognise, openacc.read),
    "gnss": _table(published.GNSS, "CSV with t_s, id, lat, lon and speed_mps"),
}
"""By the word of `--format`, in the order in which they are tried; beside them there are `bsm` and `columns`."""

_IN_FOLDERS: Final = ("bsmp1", "datawsu")
"""Published as folders of tables; a folder of others may hold anything."""

_BSM_READERS: Final[Mapping[str, Reader]] = {
    ".jsonl": read_lines, ".ndjson": read_lines, ".csv": read_csv, ".parquet": read_parquet
}  # fmt: skip


class Located(NamedTuple):
    """A record and its place in words, or why there is none."""

    source: Source
    number: int
    record: Record
    drive: str = ""
    refusal: Refusal | None = None
    truth: Truth | None = None


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
def open_recordings(names: Sequence[str], form: str = AUTO, columns: str | None = None) -> Iterator[Recordings]:
    """Open recordings of one format, or each of the format that its first bytes or its name tell.

    A folder stands for the recordings of `form` in it. With AUTO these are the tables of a Safety Pilot folder.

    `columns` is a mapping for tables that have columns of their own.

    Raises
    ------
    RecordingError
        One of them cannot be read; also while the chunks are read.
    """
    words = (AUTO, BSM, *FORMATS)
    if form not in words:
        raise RecordingError(f"--format {form}: choose from {', '.join(words)}")
    if columns is not None and form != AUTO:
        raise RecordingError("--columns describes a table of your own: leave --format out")
    with ExitStack() as stack:
        sources, located = list[Source](), list[Iterator[list[Located]]]()
        for name in names:
            for file in _files(name, form, columns):
                source = stack.enter_context(opened(file))
                source.columns = columns
                sources.append(source)
                located.append(_located(source, _reader(source, form), may_be_empty=file != name))
        yield Recordings(sources, located[0] if len(located) == 1 else _merged(located))


def _files(name: str, form: str, columns: str | None) -> Sequence[str]:
    """Return the recordings in a folder and in those within it, by name; the name itself where it is no folder."""
    folder = Path(name)
    if name == STANDARD_INPUT or not folder.is_dir():
        return (name,)
    files = [str(file) for file in sorted(folder.rglob("*")) if file.is_file()]
    if columns is None:
        forms = _IN_FOLDERS if form == AUTO else (form,)
        files = [file for file in files if _known(file) in forms]
    if not files:
        raise RecordingError(f"{name}: Is a directory: name the recordings in it, or their --format")
    return files


def _known(name: str) -> str | None:
    try:
        return recognised(name)
    except RecordingError:
        return None


def _reader(source: Source, form: str) -> Reader:
    if source.columns is not None:
        return _in_chunks(published.read_mapped)
    word = format_of(source.head) if form == AUTO else form
    if word is not None and word in FORMATS:
        return _in_chunks(FORMATS[word].read)
    if source.stream.peek(4)[:4] == PARQUET:
        return read_parquet
    reader = _BSM_READERS.get(source.ending)
    if reader is None and form == AUTO and source.path is not None:
        raise source.error(
            f"no recording by its ending: {', '.join(_BSM_READERS)}, each also compressed;"
            " nor by its content: see --format and --columns"
        )
    return reader or _bsm_reader(source)


def _bsm_reader(source: Source) -> Reader:
    """Return the reader of BSM v1 for a recording whose name has no ending that says it."""
    return read_lines if source.head.lstrip(BOM + b" \t\r\n")[:1] == b"{" else read_csv


def recognised(name: str) -> str | None:
    """Return the format that the first bytes of a file tell; None where they tell none.

    Raises
    ------
    RecordingError
        The file cannot be read.
    """
    with opened(name) as source:
        return format_of(source.head)


def format_of(head: bytes) -> str | None:
    """Return the format of a recording that begins with these bytes; None where they tell none."""
    if _is_bsm(head):
        return BSM
    return next((word for word, candidate in FORMATS.items() if candidate.recognise(head)), None)


def _is_bsm(head: bytes) -> bool:
    """Whether the first bytes are of BSM v1, whatever other names are among them."""
    line = head.partition(b"\n")[0]
    names = header_of(head) if line[:1] not in (b"{", b"[") else ()
    return b'"msg_cnt"' in line or {"msg_cnt", "t_us"} <= {name.lower() for name in names}


def _in_chunks(rows_of: Rows) -> Reader:
    """Return a reader of a foreign format; a recording without a single good row cannot be read."""

    def read(source: Source) -> Iterator[list[Row]]:
        rows, good, refused = rows_of(source), 0, list[Row]()
        while chunk := list(islice(rows, CHUNK)):
            good += sum(row.refusal is None for row in chunk)
            refused += [] if good or refused else chunk[:1]
            yield chunk
        if refused and not good and (refusal := refused[0].refusal) is not None:
            raise source.error(f"{refusal.detail}; no row can be read", refused[0].number)

    return read


def _located(source: Source, reader: Reader, *, may_be_empty: bool) -> Iterator[list[Located]]:
    empty = True
    with named_errors(source.name):
        for rows in reader(source):
            empty = False
            yield [Located(source, *row) for row in rows]
    if empty and not may_be_empty:
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
