"""Large CSV tables as streams: lazy scans, one run of rows at a time, never a whole file."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import polars as pl

from headway_loadtest.trajectory import SourceError

NULLS = ["", "NULL", "null"]
SPELLINGS = {"Rangerate": "RangeRate"}
RUN = "run"

Schema = Mapping[str, type[pl.DataType]]


def scan(path: Path, wanted: Schema, header: Sequence[str] | None = None) -> pl.LazyFrame:
    """Scan the wanted columns of a table, lazily; `header` names the columns of a file that has none.

    Raises
    ------
    SourceError
        The file cannot be opened, or lacks a column.
    """
    try:
        frame = pl.scan_csv(
            path,
            infer_schema=False,
            null_values=NULLS,
            has_header=header is None,
            new_columns=None if header is None else list(header),
        )
        names = [SPELLINGS.get(name, name) for name in frame.collect_schema().names()]
    except (OSError, pl.exceptions.PolarsError) as error:
        raise SourceError(f"{path}: {_first_line(error)}") from None
    absent = [name for name in wanted if name not in names]
    if absent:
        raise SourceError(f"{path}: row 1: no column {', '.join(absent)}")
    number = {name: pl.col(name).str.strip_chars().cast(pl.Float64) for name in wanted}
    return frame.rename(SPELLINGS, strict=False).select(number[name].cast(kind) for name, kind in wanted.items())


def stream(path: Path, rows: pl.LazyFrame) -> Iterator[pl.DataFrame]:
    """Yield the rows of a scan, a chunk at a time. Raises SourceError for a value that cannot be read."""
    try:
        yield from rows.collect_batches(maintain_order=True, engine="streaming")
    except (OSError, pl.exceptions.PolarsError) as error:
        raise SourceError(f"{path}: {_first_line(error)}") from None


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
