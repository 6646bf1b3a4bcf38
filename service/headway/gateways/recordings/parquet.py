"""Parquet files, read by a process of their own.

A Parquet file tells its reader how much to allocate, to repeat and to decompress. Whatever a damaged one makes of that,
an abort, a hang or all the memory, it ends a process that does nothing else, and is an error here.
"""

import atexit
import itertools
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from threading import Lock
from typing import Any, Final, NamedTuple

_PROGRAM: Final = Path(__file__).with_name("parquet_process.py")
_LIMIT_S: Final = 60
"""Time for the next rows. 20,000 take a few hundredths of a second."""
_LIMIT_BYTES: Final = 2 << 30
"""Memory for all open files: each holds a page of every column, usually 1 MB."""
_ENVIRONMENT: Final = {"ARROW_DEFAULT_MEMORY_POOL": "system", "OPENBLAS_NUM_THREADS": "1"}
"""Allocators that reserve no memory ahead, since the limit counts it."""


class ParquetError(Exception):
    """A Parquet file that cannot be read: one line, without its name."""


class Column(NamedTuple):
    """A column of a table."""

    name: str
    kind: str
    """Its type, in the words of Arrow."""
    is_text: bool


@dataclass(slots=True)
class ParquetTable:
    """An open Parquet file."""

    columns: Sequence[Column]
    _number: int
    _rows: int
    _done: int = 0

    def batches(self) -> Iterator[tuple[int, list[list[Any]]]]:
        """Yield how many rows came before, and the values of each column for the next rows.

        Raises
        ------
        ParquetError
            The file is damaged.
        """
        while (values := _PROCESS.ask("next", self._number)) is not None:
            first, self._done = self._done, self._done + len(values[0])
            yield first, values

    def share(self) -> float:
        """Return how much is read, 0 to 1."""
        return min(self._done / self._rows, 1.0) if self._rows else 0.0


@contextmanager
def opened_table(path: Path) -> Iterator[ParquetTable]:
    """Open a Parquet file.

    Raises
    ------
    ParquetError
        It is damaged, has no columns, or pyarrow is not installed.
    """
    if find_spec("pyarrow") is None:
        raise ParquetError("Parquet needs pyarrow: pip install 'headway[recordings]'")
    number = next(_NUMBERS)
    columns, rows = _PROCESS.ask("open", number, str(path))
    try:
        if not columns:
            raise ParquetError("no columns")
        yield ParquetTable([Column(*column) for column in columns], number, rows)
    finally:
        _PROCESS.close(number)


class _Process:
    """The process that reads all files; it starts with the first one, and again after one that ended it."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._connection: Connection[Any, Any] | None = None

    def ask(self, *request: object) -> Any:
        """Return the answer to a request; raises `ParquetError` where there is none, or it is an error."""
        with self._lock:
            connection = self._connection or self._start()
            try:
                connection.send(request)
                answer = connection.recv()
            except (EOFError, OSError, pickle.UnpicklingError):
                raise ParquetError(_ending(self._end())) from None
            except BaseException:  # no later request may get this answer
                self._end()
                raise
        if isinstance(answer, str):
            raise ParquetError(f"not readable as Parquet: {answer.partition(chr(10))[0]}")
        return answer

    def close(self, number: int) -> None:
        """Close a file, if it is still open."""
        if self._connection is not None:
            self.ask("close", number)

    def end(self) -> None:
        """End the process, if there is one."""
        with self._lock:
            if self._process is not None:
                self._end()

    def _start(self) -> "Connection[Any, Any]":
        self._connection, theirs = Pipe()
        with theirs:
            self._process = subprocess.Popen(  # noqa: S603 - this Python and a file of ours
                [sys.executable, "-P", _PROGRAM, *map(str, (theirs.fileno(), _LIMIT_S, _LIMIT_BYTES))],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env=os.environ | _ENVIRONMENT,
                start_new_session=True,  # Ctrl-C is not for it
            )
        return self._connection

    def _end(self) -> int:
        assert self._process is not None
        assert self._connection is not None
        self._process.kill()
        status = self._process.wait()
        self._connection.close()
        self._process = self._connection = None
        return status


def _ending(status: int) -> str:
    if status == -signal.SIGALRM:
        return f"damaged: no more rows within {_LIMIT_S} s"
    how = signal.Signals(-status).name if status < 0 else f"status {status}"
    return f"damaged: the process that read it ended ({how})"


_NUMBERS: Final = itertools.count()
_PROCESS: Final = _Process()
atexit.register(_PROCESS.end)
