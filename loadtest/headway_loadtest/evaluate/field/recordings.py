"""Recordings as columns, one value for each drive: GNSS tables, pair files, BSM v1 JSON lines, and any other format.

Records of one `Recording` meet each other on the road; those of two never do.
"""

import gzip
import json
import zlib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
import polars as pl
from numpy.typing import NDArray

from headway_loadtest.sources import pairs
from headway_loadtest.sources.drive import F64, I64, SourceError
from headway_loadtest.sources.road import displace
from headway_schemas.keys import sanitise_id

Records = NDArray[np.void]
Bools = NDArray[np.bool_]
MESSAGE = np.dtype(
    [
        ("vehicle", "i8"),  # index into `Recording.vehicles`
        ("msg_cnt", "i8"),
        ("t_us", "i8"),  # event time
        ("received_us", "i8"),
        ("lat_deg", "f8"),
        ("lon_deg", "f8"),
        ("speed_mps", "f8"),
        ("heading_deg", "f8"),
        ("accel_mps2", "f8"),
        ("accuracy_m", "f8"),
        ("length_m", "f8"),
    ]
)
"""One message; NaN where the sender gave no value."""

T0_US = 1_700_000_000_000_000
"""Event time of `t_s` = 0 in tables that count from the start of their drive."""
DELAY_US = 20_000
"""From event time to reception where the recording does not give it."""
READING_NOISE = 0.01
"""Standard deviation added to the smoothed readings of a pair file, m and m/s, as in the published experiment."""
GNSS_COLUMNS = ("t_s", "id", "lat", "lon", "speed_mps")
MEASURED = ("lat", "lon", "speed_mps")
OPTIONAL = ("heading_deg", "accel_mps2", "accuracy_m", "length_m")
_LINE_BYTES_MAX = 65_536
_INTEGER_MAX = 2**63 - 1
JSON_ENDINGS = (".jsonl", ".jsonl.gz", ".ndjson")


class Row(NamedTuple):
    """A record of BSM v1, or what the ground truth of a data set says of one, or both."""

    drive: str
    record: Mapping[str, Any]
    """Empty where the row is ground truth only."""
    message: str | None = None
    """Name of the message in the ground truth."""
    is_attack: bool | None = None
    """None: unknown, or another row tells it."""


class Reader(Protocol):
    """Reads recordings of other systems."""

    def recognises(self, path: Path) -> bool:
        """Whether the file is one."""

    def rows(self, path: Path) -> Iterable[Row]:
        """Yield its rows; raises `SourceError`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Recording:
    """Messages of vehicles that share a road, in the order of reception.

    `group` is the name of the folder, the set that results are summed over. `run` is the noise realisation of a
    simulated recording; None for a recorded one, which is the same in every run.
    """

    group: str
    name: str
    vehicles: tuple[str, ...]
    messages: Records
    """(n,) of dtype MESSAGE."""
    run: int | None = None

    @property
    def tracks(self) -> list[Records]:
        """Messages of each vehicle in event-time order, copies; vehicle i at index i."""
        order = np.lexsort((self.messages["t_us"], self.messages["vehicle"]))
        ends = np.cumsum(np.bincount(self.messages["vehicle"], minlength=len(self.vehicles)))
        return np.split(self.messages[order], ends[:-1])


def assemble(recording: Recording, tracks: Sequence[Records]) -> Recording:
    """Return the recording with these messages instead, put into the order of reception."""
    messages = np.concatenate(tracks)
    return replace(recording, messages=messages[by_reception(messages)])


def by_reception(messages: Records) -> I64:
    """Return the order of reception as indices; event time and vehicle decide between equal times."""
    return np.lexsort((messages["vehicle"], messages["t_us"], messages["received_us"]))


def course_deg(track: Records) -> F64:
    """Return the heading of each message, with gaps filled from its neighbours or from the displacement.

    It is 0 where neither is known.
    """
    heading = track["heading_deg"]
    known = np.isfinite(heading)
    if known.any():
        at = np.arange(len(track))
        filled: F64 = np.degrees(np.interp(at, at[known], np.unwrap(np.radians(heading[known])))) % 360.0
        return filled
    if len(track) < 2:
        return np.zeros(len(track))
    north, east = local_m(track, track["lat_deg"][0], track["lon_deg"][0])
    course: F64 = np.degrees(np.arctan2(np.gradient(east), np.gradient(north))) % 360.0
    return course


def local_m(track: Records, lat_deg: float, lon_deg: float) -> tuple[F64, F64]:
    """Return metres north and east of a point, on a plane that touches the ellipsoid there."""
    probe = np.array([lat_deg])
    north_lat, _ = displace(probe, np.zeros(1), np.zeros(1), 1.0)
    _, east_lon = displace(probe, np.zeros(1), np.full(1, 90.0), 1.0)
    north_m = (track["lat_deg"] - lat_deg) / float(north_lat[0] - lat_deg)
    east_m = (track["lon_deg"] - lon_deg) / float(east_lon[0])
    return north_m, east_m


def move(track: Records, ahead_m: F64 | float, right_m: F64 | float = 0.0) -> None:
    """Displace the positions of a track along and across its heading, in place."""
    track["lat_deg"], track["lon_deg"] = displace(
        track["lat_deg"], track["lon_deg"], course_deg(track), ahead_m, right_m
    )


def load(path: Path, runs: int, seed: int, without: Sequence[Path] = ()) -> Iterator[Recording]:
    """Yield the recordings at or below `path`; a pair file gives one for each run, with noise of its own.

    Raises
    ------
    SourceError
        A file cannot be read, or there is none beside those of `without`.
    """
    files = sorted(file for file in path.rglob("*") if _is_recording(file)) if path.is_dir() else [path]
    files = [file for file in files if file not in without]
    if not files and without:
        return
    if not files or not files[0].is_file():
        raise SourceError(f"{path}: no recording (.csv, .jsonl) there")
    if not _is_recording(files[0]):
        raise SourceError(f"{path}: of no form that is recognised by its content; .csv and .jsonl are by their ending")
    for file in files:
        if file.name.endswith(JSON_ENDINGS):
            yield read_bsm_lines(file)
        elif _is_pair(file):
            yield from (read_pair(file, seed, run) for run in range(runs))
        else:
            yield read_gnss(file)


def _is_recording(path: Path) -> bool:
    return path.name.endswith((".csv", *JSON_ENDINGS))


def _is_pair(path: Path) -> bool:
    with path.open("rb") as lines:
        return b"follower_x_m" in lines.readline(_LINE_BYTES_MAX)


def _named(path: Path, vehicles: tuple[str, ...], messages: Records, run: int | None = None) -> Recording:
    bare = Recording(group=path.resolve().parent.name, name=path.stem, vehicles=vehicles, messages=messages, run=run)
    return assemble(bare, [messages])


def read_gnss(path: Path) -> Recording:
    """Read a table with the columns `t_s,id,lat,lon,speed_mps` and any of `OPTIONAL` and `msg_cnt`.

    Rows without position or speed are left out: a message cannot be made of them.
    """
    try:
        table = pl.read_csv(path, infer_schema=False)
    except (OSError, pl.exceptions.PolarsError) as error:
        raise SourceError(f"{path}: not readable as CSV: {str(error).partition(chr(10))[0]}") from None
    absent = [name for name in GNSS_COLUMNS if name not in table.columns]
    if absent:
        raise SourceError(f"{path}: row 1: no column {', '.join(absent)}; a recording has {','.join(GNSS_COLUMNS)}")
    numbers = {
        name: table[name].str.strip_chars().cast(pl.Float64, strict=False).to_numpy().astype(np.float64)
        for name in table.columns
        if name != "id"
    }
    whole = np.all([np.isfinite(numbers[name]) for name in GNSS_COLUMNS if name != "id"], axis=0)
    ids = [sanitise_id(name or "") for name in table["id"].to_list()]
    vehicles, which = np.unique(np.array(ids), return_inverse=True)
    messages = empty(len(ids))
    messages["vehicle"] = which
    messages["t_us"] = T0_US + np.round(np.nan_to_num(numbers["t_s"]) * 1e6).astype(np.int64)
    messages["received_us"] = messages["t_us"] + DELAY_US
    messages["lat_deg"], messages["lon_deg"] = numbers["lat"], numbers["lon"]
    messages["speed_mps"] = numbers["speed_mps"]
    for name in OPTIONAL:
        if name in numbers:
            messages[name] = numbers[name]
    messages = messages[whole]
    counts = numbers.get("msg_cnt", np.full(len(ids), np.nan))[whole]
    messages["msg_cnt"] = np.where(np.isfinite(counts), np.nan_to_num(counts), counted(messages)).astype(np.int64)
    return _named(path, tuple(vehicles.tolist()), messages)


def read_bsm_lines(path: Path) -> Recording:
    """Read BSM v1 JSON lines, each with an optional `received_us`, gzip or not.

    Records whose position or speed is null are left out, as a service rejects them.
    """
    rows: list[tuple[Any, ...]] = []
    index: dict[str, int] = {}
    opener = gzip.open if path.suffix == ".gz" else open
    number = 0
    try:
        with opener(path, "rb") as lines:
            while line := lines.readline(_LINE_BYTES_MAX):
                number += 1
                bsm = json.loads(line) if line.strip() else {}
                if all(bsm.get(name) is not None for name in MEASURED):
                    rows.append(_row(bsm, index))
    except (OSError, EOFError, zlib.error) as error:
        raise SourceError(f"{path}: {error}") from None
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError, RecursionError) as error:
        raise SourceError(f"{path}: line {number}: not a BSM v1 record ({error})") from None
    if not rows:
        raise SourceError(f"{path}: no records in it")
    return _named(path, tuple(index), np.array(rows, MESSAGE))


def _row(bsm: dict[str, Any], index: dict[str, int]) -> tuple[Any, ...]:
    optional = (np.nan if bsm.get(name) is None else float(bsm[name]) for name in OPTIONAL)
    return (
        index.setdefault(str(bsm["id"]), len(index)),
        _integer(bsm["msg_cnt"]),
        _integer(bsm["t_us"]),
        _integer(bsm.get("received_us") or bsm["t_us"] + DELAY_US),
        float(bsm["lat"]),
        float(bsm["lon"]),
        float(bsm["speed_mps"]),
        *optional,
    )


def _integer(value: Any) -> int:
    if not -_INTEGER_MAX <= value <= _INTEGER_MAX:
        raise ValueError(f"{value} is beyond 64 bits")
    return int(value)


def read_pair(path: Path, seed: int, run: int) -> Recording:
    """Read a pair file as two vehicles on a winding road, with white noise of `READING_NOISE` along it."""
    drives = pairs.read_pair(path)
    rng = np.random.default_rng([seed, run, *path.stem.encode()])
    tracks = []
    for which, drive in enumerate(drives):
        n = len(drive.t_s)
        track = empty(n)
        track["vehicle"] = which
        track["t_us"] = T0_US + np.round(drive.t_s * 1e6).astype(np.int64)
        track["received_us"] = track["t_us"] + DELAY_US
        track["lat_deg"], track["lon_deg"], track["heading_deg"] = drive.lat, drive.lon, drive.heading_deg
        track["speed_mps"] = np.maximum(drive.speed_mps + rng.normal(0.0, READING_NOISE, n), 0.0)
        track["length_m"] = drive.length_m or np.nan
        track["msg_cnt"] = np.arange(n) % 128
        move(track, rng.normal(0.0, READING_NOISE, n))
        tracks.append(track)
    return _named(path, tuple(drive.vehicle for drive in drives), np.concatenate(tracks), run)


def empty(n: int) -> Records:
    """Return n messages whose optional values are absent."""
    messages = np.zeros(n, MESSAGE)
    for name in OPTIONAL:
        messages[name] = np.nan
    return messages


def counted(messages: Records) -> I64:
    """Return a message counter for each vehicle, in the order of the messages."""
    counts = np.zeros(len(messages), np.int64)
    for vehicle in np.unique(messages["vehicle"]):
        at = np.flatnonzero(messages["vehicle"] == vehicle)
        counts[at] = np.arange(at.size) % 128
    return counts


@dataclass(slots=True)
class _Drive:
    file: Path
    vehicles: dict[str, int] = field(default_factory=dict)
    rows: list[tuple[Any, ...]] = field(default_factory=list)
    messages: list[str | None] = field(default_factory=list)
    """Name of each row's message in the ground truth."""

    def add(self, row: Row) -> None:
        record, t_us = row.record, row.record["t_us"]
        self.messages.append(row.message)
        self.rows.append(
            (
                self.vehicles.setdefault(record["id"], len(self.vehicles)),
                record["msg_cnt"],
                t_us,
                record.get("received_us") or t_us + DELAY_US,
                *(record[name] for name in ("lat", "lon", "speed_mps")),
                *(np.nan if record.get(name) is None else record[name] for name in OPTIONAL),
            )
        )


def load_recorded(files: Sequence[Path], reader: Reader) -> Iterator[tuple[Recording, Bools | None]]:
    """Yield a recording for each drive, and (n,) which of its messages are attacks; None without ground truth.

    Ground truth may be in another file of the same folder.

    Raises
    ------
    SourceError
        A file cannot be read, or there is no record in any.
    """
    drives: dict[tuple[Path, str], _Drive] = {}
    attacks: dict[tuple[Path, str | None], bool] = {}
    for file in files:
        for row in reader.rows(file):
            if row.is_attack is not None:
                attacks[file.parent, row.message] = row.is_attack
            if row.record:
                drives.setdefault((file, row.drive), _Drive(file)).add(row)
    if not drives:
        raise SourceError(f"{', '.join(map(str, files))}: no records in it")
    of_file = Counter(drive.file for drive in drives.values())
    for number, drive in enumerate(drives.values()):
        name = drive.file.stem if of_file[drive.file] == 1 else f"{drive.file.stem}-{number}"
        messages = np.array(drive.rows, MESSAGE)
        order = by_reception(messages)
        known = [attacks.get((drive.file.parent, message)) for message in drive.messages]
        yield (
            Recording(
                group=drive.file.resolve().parent.name,
                name=name,
                vehicles=tuple(drive.vehicles),
                messages=messages[order],
            ),
            None if set(known) == {None} else np.array([one is True for one in known])[order],
        )
