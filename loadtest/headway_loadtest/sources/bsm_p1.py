"""SPMD BsmP1 tables: basic safety messages as roadside units and vehicles received them.

GenTime is in microseconds since 2004-01-01 UTC, Speed in m/s, positions and Heading in degrees, each with values that
stand for unavailable above the range of the others. The two-month file has no header.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl

from headway_loadtest.sources.drive import Drive, Scene
from headway_loadtest.sources.resample import smooth_path
from headway_loadtest.sources.tables import first_line, runs, stream
from headway_schemas.keys import sanitise_id

HEADER = (
    *("RxDevice", "FileId", "TxDevice", "GenTime", "TxRandom", "MsgCount", "DSecond", "Latitude", "Longitude"),
    *("Elevation", "Speed", "Heading", "Ax", "Ay", "Az", "Yawrate", "PathCount", "RadiusOfCurve", "Confidence"),
)
MICROSECONDS = 1e6
WANTED = {
    **dict.fromkeys(("RxDevice", "FileId", "TxDevice", "GenTime"), pl.Int64),
    **dict.fromkeys(("Latitude", "Longitude", "Speed", "Heading"), pl.Float64),
}
LOG = ("RxDevice", "FileId")
AVAILABLE = (
    pl.col("Latitude").abs() <= 90.0,
    pl.col("Longitude").abs() <= 180.0,
    pl.col("Speed").is_between(0.0, 163.8, closed="left"),
    pl.col("Heading").is_between(0.0, 360.0, closed="left"),
)


@dataclass(frozen=True, slots=True)
class BsmP1:
    """Scenes of a BsmP1 file: one receiver's log, a vehicle for each sender in it."""

    path: Path

    def __iter__(self) -> Iterator[Scene]:
        header = None if first_line(self.path).startswith(HEADER[0]) else HEADER
        for log in runs(stream(self.path, WANTED, *AVAILABLE, header=header), LOG):
            start = log["GenTime"].min()
            yield tuple(
                _drive(received.with_columns(pl.col("GenTime") - start).unique("GenTime", keep="first").sort("GenTime"))
                for received in log.partition_by("TxDevice", maintain_order=True)
            )


def _drive(received: pl.DataFrame) -> Drive:
    file_id, sender = received.select("FileId", "TxDevice").row(0)
    t_s = received["GenTime"].to_numpy() / MICROSECONDS
    lat, lon, speed_mps, heading_deg = (
        received[name].to_numpy().astype(np.float64) for name in ("Latitude", "Longitude", "Speed", "Heading")
    )
    x_m, lat, lon = smooth_path(t_s, lat, lon, speed_mps, heading_deg)
    return Drive(
        vehicle=sanitise_id(f"bsm-{sender}-{file_id}"),
        t_s=t_s,
        x_m=x_m,
        speed_mps=speed_mps,
        lat=lat,
        lon=lon,
        heading_deg=heading_deg,
    )
