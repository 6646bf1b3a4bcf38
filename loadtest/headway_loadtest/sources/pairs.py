"""Pair files: a leader and a follower along one road, CSV with the columns of `COLUMNS`, in SI units.

Both cars are sent as vehicles of their own. Each pair gets a gently winding road to itself.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl

from headway_loadtest.sources.drive import F64, Drive, Scene, SourceError
from headway_loadtest.sources.road import Road
from headway_schemas.keys import sanitise_id

COLUMNS = ("t_s", "leader_x_m", "follower_x_m", "leader_v_mps", "follower_v_mps", "leader_length_m")
ORIGIN_LAT, ORIGIN_LON = 42.28, -83.74
ROADS_APART_DEG = 0.02
HEADER_LINES = 1
ROAD_M_MAX = 1e6
"""A road has a point for each metre."""


@dataclass(frozen=True, slots=True)
class Pairs:
    """Scenes of two vehicles, one per file, read when they are asked for."""

    paths: Sequence[Path]

    def __iter__(self) -> Iterator[Scene]:
        for index, path in enumerate(self.paths):
            yield read_pair(path, lon=ORIGIN_LON + index * ROADS_APART_DEG)


def read_pair(path: Path, lat: float = ORIGIN_LAT, lon: float = ORIGIN_LON) -> Scene:
    """Read a pair file as two drives on a road that starts at a point on the earth: the leader's, the follower's.

    Raises
    ------
    SourceError
        Names the file, the row (the header is row 1) and what is wrong there.
    """
    t_s, leader_x_m, follower_x_m, leader_v_mps, follower_v_mps, length_m = _columns(path)
    road = Road.winding(lat, lon, min(leader_x_m.min(), follower_x_m.min()), max(leader_x_m.max(), follower_x_m.max()))
    name = sanitise_id(f"{path.parent.name}-{path.stem}")[-56:]
    t_s = t_s - t_s[0]
    return (
        _drive(f"{name}-leader", t_s, leader_x_m, leader_v_mps, road, float(length_m[0])),
        _drive(f"{name}-follower", t_s, follower_x_m, follower_v_mps, road, None),
    )


def _drive(vehicle: str, t_s: F64, x_m: F64, v_mps: F64, road: Road, length_m: float | None) -> Drive:
    lat, lon, heading_deg = road.at(x_m)
    return Drive(
        vehicle=vehicle,
        t_s=t_s,
        x_m=x_m,
        speed_mps=v_mps,
        lat=lat,
        lon=lon,
        heading_deg=heading_deg,
        length_m=length_m,
    )


def _columns(path: Path) -> list[F64]:
    try:
        text = pl.read_csv(path, infer_schema=False)
    except (OSError, pl.exceptions.PolarsError) as error:
        raise SourceError(f"{path}: {str(error).partition(chr(10))[0]}") from None
    absent = [name for name in COLUMNS if name not in text.columns]
    if absent:
        raise SourceError(
            f"{path}: row 1: no column {', '.join(absent)}; a pair file has {','.join(COLUMNS)};"
            " for another table see --columns"
        )
    if text.is_empty():
        raise SourceError(f"{path}: no rows below the header")
    columns = [_numbers(path, text, name) for name in COLUMNS]
    t_s, leader_x_m, follower_x_m, *speeds, length_m = columns
    _require(path, np.diff(t_s, prepend=-np.inf) > 0, "t_s does not increase")
    _require(path, leader_x_m > follower_x_m, "the leader is not ahead of the follower")
    _require(path, leader_x_m - follower_x_m.min() < ROAD_M_MAX, "the leader is over 1,000 km ahead of a follower")
    _require(path, np.minimum(*speeds) >= 0, "a speed is below 0")
    _require(path, length_m > 0, "leader_length_m is not above 0")
    return columns


def _numbers(path: Path, text: pl.DataFrame, name: str) -> F64:
    column = text[name].str.strip_chars().cast(pl.Float64, strict=False).to_numpy().astype(np.float64)
    wrong = np.flatnonzero(~np.isfinite(column))
    if len(wrong):
        row = int(wrong[0])
        raise SourceError(f"{path}: row {row + 1 + HEADER_LINES}: {name} is '{text[name][row] or ''}', not a number")
    return column


def _require(path: Path, holds: np.ndarray[tuple[int], np.dtype[np.bool_]], problem: str) -> None:
    wrong = np.flatnonzero(~holds)
    if len(wrong):
        raise SourceError(f"{path}: row {int(wrong[0]) + 1 + HEADER_LINES}: {problem}")
