"""Safety Pilot Model Deployment (SPMD) trips: DataWsu for the host, DataFrontTargets for the vehicle ahead of it.

Units of the files: Time in centiseconds, SpeedWsu in km/h, Range in m, RangeRate in m/s; GpsValidWsu or ValidCanWsu = 0
marks a row that is not to be used. The leader is the target with CIPV = 1 and a TargetType of car, truck or motorcycle;
it is another vehicle when Device, Trip or ObstacleId changes or Time jumps. It is sent as a vehicle of its own:

    v_leader = SpeedWsu / 3.6 + RangeRate,   x_leader = x_host + Range      (on the path that the host drives)

The tables are tens of gigabytes and in different orders: DataWsu is read as a stream, trip by trip, and
DataFrontTargets is searched once for as many trips as `ROWS_AT_ONCE` rows hold.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import polars as pl

from headway_loadtest.sources.drive import F64, I64, Ahead, Drive, Scene
from headway_loadtest.sources.resample import smooth_path
from headway_loadtest.sources.road import Road
from headway_loadtest.sources.tables import batches, runs, stream
from headway_schemas.keys import sanitise_id

CENTISECONDS = 100.0
KMH = 3.6
CAR, TRUCK, MOTORCYCLE = 0, 1, 2
ROWS_AT_ONCE = 200_000
JUMP_S = 0.5
TRIP = ("Device", "Trip")
HOST_COLUMNS = (
    *("Device", "Trip", "Time", "GpsValidWsu", "GpsTimeWsu", "LatitudeWsu", "LongitudeWsu", "AltitudeWsu"),
    *("GpsHeadingWsu", "GpsSpeedWsu", "HdopWsu", "PdopWsu", "FixQualityWsu", "GpsCoastingWsu", "ValidCanWsu"),
    *("YawRateWsu", "SpeedWsu", "TurnSngRWsu", "TurnSngLWsu", "BrakeAbsTcsWsu", "AxWsu", "PrndlWsu"),
    *("VsaActiveWsu", "HeadlampWsu", "WiperWsu", "ThrottleWsu", "SteerWsu"),
)
TARGET_COLUMNS = (
    *("Device", "Trip", "Time", "TargetId", "ObstacleId", "Range", "RangeRate", "Transversal", "TargetType"),
    *("Status", "CIPV"),
)
HOST = {
    **dict.fromkeys((*TRIP, "Time", "GpsValidWsu", "ValidCanWsu"), pl.Int64),
    **dict.fromkeys(("LatitudeWsu", "LongitudeWsu", "GpsHeadingWsu", "SpeedWsu"), pl.Float64),
}
TARGET = {
    **dict.fromkeys((*TRIP, "Time", "ObstacleId", "TargetType", "CIPV"), pl.Int64),
    **dict.fromkeys(("Range", "RangeRate"), pl.Float64),
}


@dataclass(frozen=True, slots=True)
class SpmdTrips:
    """Scenes of a DataWsu file: the host of a trip and the vehicles that were ahead of it."""

    host_path: Path
    targets_path: Path | None

    def __iter__(self) -> Iterator[Scene]:
        rows = stream(self.host_path, HOST, pl.col("GpsValidWsu") != 0, pl.col("ValidCanWsu") != 0)
        trips = runs(rows, TRIP)
        for some in batches(trips, ROWS_AT_ONCE):
            targets = self._targets(some)
            for trip in some:
                key = trip.select(TRIP).row(0)
                yield _scene(trip, targets.get(key))

    def _targets(self, trips: Sequence[pl.DataFrame]) -> dict[tuple[object, ...], pl.DataFrame]:
        if self.targets_path is None:
            return {}
        wanted = pl.concat([trip.select(TRIP).head(1) for trip in trips])
        leads = pl.col("TargetType").is_in([CAR, TRUCK, MOTORCYCLE])
        found = [
            rows.join(wanted, on=TRIP, how="semi")
            for rows in stream(self.targets_path, TARGET, pl.col("CIPV") == 1, leads)
        ]
        return dict(pl.concat(found).partition_by(TRIP, as_dict=True)) if found else {}


def _scene(trip: pl.DataFrame, targets: pl.DataFrame | None) -> Scene:
    trip = trip.unique("Time", keep="first").sort("Time")
    columns = {name: trip[name].to_numpy().astype(np.float64) for name in HOST}
    t_s = (columns["Time"] - columns["Time"][0]) / CENTISECONDS
    speed_mps = np.maximum(columns["SpeedWsu"], 0.0) / KMH
    heading_deg = columns["GpsHeadingWsu"] % 360.0
    x_m, lat, lon = smooth_path(t_s, columns["LatitudeWsu"], columns["LongitudeWsu"], speed_mps, heading_deg)
    device, number = trip.select(TRIP).row(0)
    host = Drive(
        vehicle=sanitise_id(f"spmd-{device}-{number}"),
        t_s=t_s,
        x_m=x_m,
        speed_mps=speed_mps,
        lat=lat,
        lon=lon,
        heading_deg=heading_deg,
    )
    if targets is None:
        return (host,)
    joined = trip.select("Time").join(
        targets.unique("Time", keep="first"), on="Time", how="left", maintain_order="left"
    )
    return _with_leaders(host, joined)


def _with_leaders(host: Drive, targets: pl.DataFrame) -> Scene:
    obstacle = targets["ObstacleId"].fill_null(-1).to_numpy()
    range_m = targets["Range"].cast(pl.Float64).fill_null(np.nan).to_numpy()
    range_rate_mps = targets["RangeRate"].cast(pl.Float64).fill_null(np.nan).to_numpy()
    which = _events(obstacle, host.t_s)
    ids = tuple(f"{host.vehicle}-ahead-{k}" for k in range(int(which.max()) + 1))
    road = Road.driven(host.x_m, host.lat, host.lon, host.heading_deg)
    leaders: list[Drive] = []
    for k, vehicle in enumerate(ids):
        there = which == k
        x_m = host.x_m[there] + range_m[there]
        lat, lon, heading_deg = road.at(x_m)
        leaders.append(
            Drive(
                vehicle=vehicle,
                t_s=host.t_s[there],
                x_m=x_m,
                speed_mps=np.maximum(host.speed_mps[there] + range_rate_mps[there], 0.0),
                lat=lat,
                lon=lon,
                heading_deg=heading_deg,
            )
        )
    return (replace(host, ahead=Ahead(ids, which, range_m, range_rate_mps)), *leaders)


def _events(obstacle: I64, t_s: F64) -> I64:
    """(n,) number of the following event that each sample belongs to, -1 where no vehicle is ahead."""
    seen = obstacle >= 0
    began = seen & np.concatenate([[True], (np.diff(obstacle) != 0) | (np.diff(t_s) > JUMP_S)])
    return np.where(seen, np.cumsum(began) - 1, -1)
