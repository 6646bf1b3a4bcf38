"""Reads Parquet files for another process: `python parquet_process.py DESCRIPTOR SECONDS BYTES`.

Time for an answer and memory are limited, so that a file which asks for more ends this process and no other. Nothing
of headway is imported: it starts in a fifth of a second.

A request is `("open", number, path)`, `("next", number)` or `("close", number)`, with a number of the caller's for the
file. Answers are the columns and the count of rows, then the values of each column for the next rows, then None.
An answer that is text says why the file cannot be read.
"""

import resource
import signal
import sys
from collections.abc import Iterator
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet as pq

_CELLS_AT_ONCE: Final = 160_000
_BUFFER_BYTES: Final = 65_536
"""A buffer for each column. Without one, pyarrow reads the whole row group."""


def read(path: str) -> Iterator[Any]:
    """Yield `(columns, rows)`, each column with name, type and whether it is text; then columns of values.

    Raises
    ------
    Exception
        Of any type that pyarrow or a conversion raises; ValueError where rows are missing.
    """
    with pa.OSFile(path) as raw, pq.ParquetFile(raw, pre_buffer=False, buffer_size=_BUFFER_BYTES) as file:
        schema, rows = file.schema_arrow, file.metadata.num_rows
        yield [(column.name, str(column.type), _is_text(column.type)) for column in schema], rows
        done = 0
        for batch in file.iter_batches(max(_CELLS_AT_ONCE // (len(schema) or 1), 1), use_threads=False):
            done += batch.num_rows
            yield [_values(*column) for column in zip(schema.names, batch.columns, strict=True)]
        if done != rows:
            raise ValueError(f"{done} rows of {rows}")


def _is_text(kind: pa.DataType) -> bool:
    of = kind.value_type if pa.types.is_dictionary(kind) else kind
    return bool(pa.types.is_string(of) or pa.types.is_large_string(of) or pa.types.is_string_view(of))


def _values(name: str, column: pa.Array) -> list[Any]:
    kind = column.type
    try:
        if pa.types.is_timestamp(kind):  # a datetime holds microseconds
            column = column.cast(pa.timestamp("us", "UTC" if kind.tz else None), safe=False)
        elif pa.types.is_duration(kind) or pa.types.is_time64(kind):
            column = column.cast(pa.int64())
        values: list[Any] = column.to_pylist()
    except (ValueError, OverflowError) as error:
        raise ValueError(f"column {name}: {error}") from None
    return values


def _serve(connection: Connection, limit_s: int) -> None:
    files: dict[int, Iterator[Any]] = {}
    while True:
        action, number, *path = connection.recv()
        signal.alarm(limit_s)
        answer = None
        try:
            if action == "open":
                files[number] = read(*path)
            if action == "close":
                files.pop(number, None)
            elif number in files:
                answer = next(files[number], None)
            else:
                answer = "its process ended with another file"
        except MemoryError:
            files.pop(number, None)
            answer = "takes too much memory"
        except Exception as error:  # noqa: BLE001 - whatever a file makes pyarrow raise
            files.pop(number, None)
            answer = str(error) or type(error).__name__
        signal.alarm(0)
        connection.send(answer)


def _main() -> None:
    descriptor, limit_s, limit_bytes = map(int, sys.argv[1:])
    for limit, bound in ((resource.RLIMIT_DATA, limit_bytes), (resource.RLIMIT_CORE, 0)):
        with suppress(ValueError):  # the system allows less already
            resource.setrlimit(limit, (bound, resource.getrlimit(limit)[1]))
    with suppress(EOFError, BrokenPipeError):  # the caller has ended
        _serve(Connection(descriptor), limit_s)


if __name__ == "__main__":
    _main()
