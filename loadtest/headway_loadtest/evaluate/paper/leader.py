"""The leader of the published experiment: one car's speed at 10 Hz, CSV with `t_s`, `x_m`, `v_mps`."""

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite
from pathlib import Path

import numpy as np

from headway_loadtest.sources.drive import F64, SourceError

COLUMNS = ("t_s", "x_m", "v_mps")
INTERVAL_S = 0.1
INTERVAL_TOLERANCE_S = 0.01
SAMPLES_MIN = 600
"""One minute: a shorter drive holds a handful of events, and its AUC is meaningless."""

HEAD_START_M = 10.0
"""Where the leader's front is when the experiment begins; the follower's is at 5 m."""


class LeaderFileError(SourceError):
    """A leader file that cannot be used: one line with the file, the row (the header is row 1) and the problem."""


@dataclass(frozen=True, slots=True)
class Leader:
    """The leader's drive, (n,) each: front along the road in m, speed in m/s, every `INTERVAL_S`."""

    x_m: F64
    v_mps: F64

    @property
    def t_s(self) -> F64:
        """(n,) s since the start."""
        return INTERVAL_S * np.arange(len(self.x_m), dtype=np.float64)


def read_leader(path: Path) -> Leader:
    """Read a leader's drive and put its start at `HEAD_START_M`.

    Raises
    ------
    LeaderFileError
        The file cannot be opened, lacks a column, holds something that is no number, leaves samples out, or is short.
    """
    try:
        with path.open(encoding="utf-8", newline="") as file:
            values = _values(path, csv.reader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else error
        raise LeaderFileError(f"{path}: {reason}; give a CSV with the columns {', '.join(COLUMNS)}") from None
    if len(values) < SAMPLES_MIN:
        raise LeaderFileError(
            f"{path}: {len(values)} samples are too short a drive; at least {SAMPLES_MIN} "
            f"({SAMPLES_MIN * INTERVAL_S:g} s at 10 Hz) are needed"
        )
    t_s, x_m, v_mps = np.ascontiguousarray(np.array(values).T)
    odd = np.flatnonzero(np.abs(np.diff(t_s) - INTERVAL_S) > INTERVAL_TOLERANCE_S)
    if odd.size:
        row = int(odd[0]) + 3
        raise LeaderFileError(
            f"{path}: row {row}: t_s goes from {t_s[odd[0]]:g} to {t_s[odd[0] + 1]:g}; "
            f"the experiment needs a sample every {INTERVAL_S:g} s without gaps"
        )
    return Leader(x_m - x_m[0] + HEAD_START_M, v_mps)


def _values(path: Path, rows: Iterator[list[str]]) -> list[list[float]]:
    header = [name.strip() for name in next(rows, [])]
    absent = [name for name in COLUMNS if name not in header]
    if absent:
        raise LeaderFileError(f"{path}: row 1: no column {', '.join(absent)}; needed are {', '.join(COLUMNS)}")
    at = [header.index(name) for name in COLUMNS]
    return [
        [_number(path, number, row, name, i) for name, i in zip(COLUMNS, at, strict=True)]
        for number, row in enumerate(rows, start=2)
        if row
    ]


def _number(path: Path, number: int, row: list[str], name: str, at: int) -> float:
    text = row[at] if at < len(row) else ""
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not isfinite(value):
        raise LeaderFileError(f"{path}: row {number}: {name} must be a number, not '{text}'")
    return value
