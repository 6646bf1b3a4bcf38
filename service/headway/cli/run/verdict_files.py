"""The verdict of each record as a file: CSV, JSON lines or Parquet, by its ending."""

import codecs
import csv
import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO, Any, Final, Protocol

from headway.cli.run.output_file import replaced
from headway.core.types.records import Records
from headway.errors import UserError
from headway.result import VERDICTS

COLUMNS: Final = ("id", "t_us", *(VERDICTS.names or ()))
"""Whom the record is of, when, and a row of `Result.verdicts`."""


class VerdictWriter(Protocol):
    """Writes verdicts chunk by chunk."""

    def write(self, records: Sequence[Mapping[str, Any]], verdicts: Records) -> None:
        """Write a row for each record."""


class _Lines:
    """Rows by a function that writes some of them."""

    def __init__(self, write_rows: Callable[[Iterable[tuple[Any, ...]]], None]) -> None:
        self._write_rows = write_rows

    def write(self, records: Sequence[Mapping[str, Any]], verdicts: Records) -> None:
        numbers = (map(_known, verdicts[name].tolist()) for name in VERDICTS.names or ())
        keys = ([record.get(name) for record in records] for name in ("id", "t_us"))
        self._write_rows(zip(*keys, *numbers, strict=True))


def _known(value: Any) -> Any:
    """Return None for what there is not."""
    return None if value == "" or (type(value) is float and not math.isfinite(value)) else value


@contextmanager
def verdict_writer(path: Path) -> Iterator[VerdictWriter]:
    """Give a writer by the ending of `path`.

    Raises
    ------
    UserError
        The ending is another, or the file cannot be written.
    """
    writers = {".csv": _csv, ".jsonl": _json_lines, ".parquet": _parquet}
    writer = writers.get(path.suffix.lower())
    if writer is None:
        raise UserError(f"--verdicts {path}: choose the ending {', '.join(writers)}")
    with replaced(path) as file, writer(file) as rows:
        yield rows


@contextmanager
def _json_lines(file: IO[bytes]) -> Iterator[VerdictWriter]:
    def write_rows(rows: Iterable[tuple[Any, ...]]) -> None:
        file.writelines(json.dumps(dict(zip(COLUMNS, row, strict=True))).encode() + b"\n" for row in rows)

    yield _Lines(write_rows)


@contextmanager
def _csv(file: IO[bytes]) -> Iterator[VerdictWriter]:
    writer = csv.writer(codecs.getwriter("utf-8")(file), lineterminator="\n")
    writer.writerow(COLUMNS)
    yield _Lines(writer.writerows)


@contextmanager
def _parquet(file: IO[bytes]) -> Iterator[VerdictWriter]:
    """Write CSV first, and stream it: the rows need not be in memory all at once."""
    try:
        import polars as pl
    except ModuleNotFoundError:
        raise UserError("--verdicts to Parquet needs polars: pip install 'headway[recordings]'") from None
    texts = dict.fromkeys(("id", "outcome", "sensor", "kind", "leader"), pl.String)
    schema = dict.fromkeys(COLUMNS, pl.Float64) | texts | {"t_us": pl.Int64, "anomalous": pl.Boolean}
    with TemporaryDirectory() as folder:
        path = Path(folder) / "verdicts.csv"
        with path.open("wb") as lines, _csv(lines) as rows:
            yield rows
        pl.scan_csv(path, schema=schema).sink_parquet(file)
