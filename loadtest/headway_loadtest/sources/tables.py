"""Large CSV tables as streams: a block of lines at a time, never a whole file.

The streaming iterator of polars 2.1 reads ahead without limit while its consumer works, so the blocks are cut
here; no line of these tables holds a quoted line break.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import polars as pl

from headway_loadtest.sources.drive import SourceError

NULLS = ["", "-", "N/A", "NA", "n/a", "NULL", "null", "NaN", "nan", "\\N"]
"""Cells without a value, as data sets write them."""
SPELLINGS = {"Rangerate": "RangeRate"}
RUN = "run"
BLOCK_BYTES = 1 << 24

Schema = Mapping[str, type[pl.DataType]]


def stream(path: Path, wanted: Schema, *where: pl.Expr, header: Sequence[str] | None = None) -> Iterator[pl.DataFrame]:
    """Yield the wanted columns of a table, the rows that are complete and that every expression keeps.

    `header` names the columns of a file that has none; a column has one spelling here, whatever the file's.

    Raises
    ------
    SourceError
        The file cannot be read, lacks a column, or holds a word where a number belongs.
    """
    names, blocks = _open(path, header)
    absent = [name for name in wanted if name not in names]
    if absent:
        raise SourceError(f"{path}: row 1: no column {', '.join(absent)}")
    schema = {name: pl.Float64 if name in wanted else pl.String for name in names}
    numbers = [pl.col(name).cast(kind) for name, kind in wanted.items()]
    for block in blocks:
        lines = pl.scan_csv(block, has_header=False, schema=schema, null_values=NULLS)
        try:
            yield lines.select(numbers).drop_nulls().filter(*where).collect()
        except pl.exceptions.PolarsError as error:
            raise SourceError(f"{path}: {_first_line(error)}") from None


def first_line(path: Path) -> str:
    """Return the first line of a file, without byte order mark and line end. Raises SourceError."""
    try:
        with path.open(encoding="utf-8-sig", errors="replace") as file:
            return file.readline().rstrip("\r\n")
    except OSError as error:
        raise SourceError(f"{path}: {error.strerror}") from None


def _open(path: Path, header: Sequence[str] | None) -> tuple[list[str], Iterator[bytes]]:
    names = first_line(path).split(",") if header is None else header
    return [SPELLINGS.get(name, name) for name in names], _blocks(path, skip_line=header is None)


def _blocks(path: Path, *, skip_line: bool) -> Iterator[bytes]:
    """Whole lines, about `BLOCK_BYTES` at a time."""
    with path.open("rb") as file:
        if skip_line:
            file.readline()
        while block := file.read(BLOCK_BYTES):
            yield block + file.readline()


def runs(chunks: Iterable[pl.DataFrame], by: Sequence[str]) -> Iterator[pl.DataFrame]:
    """Gather neighbouring rows with the same values in the columns `by`, across chunks."""
    parts: list[pl.DataFrame] = []
    for chunk in chunks:
        for part in chunk.with_columns(pl.struct(by).rle_id().alias(RUN)).partition_by(RUN, include_key=False):
            if parts and parts[-1].select(by).row(-1) != part.select(by).row(0):
                yield pl.concat(parts)
                parts = []
            parts.append(part)
    if parts:
        yield pl.concat(parts)


def batches(frames: Iterable[pl.DataFrame], rows: int) -> Iterator[list[pl.DataFrame]]:
    """Gather neighbouring frames until they hold that many rows."""
    held: list[pl.DataFrame] = []
    for frame in frames:
        held.append(frame)
        if sum(map(len, held)) >= rows:
            yield held
            held = []
    if held:
        yield held


def _first_line(error: Exception) -> str:
    return str(error).strip().partition("\n")[0]
