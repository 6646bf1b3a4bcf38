"""Misses: a sender that has stopped, detected by its own interval and by its neighbours.

Silence alone proves nothing. The vehicle may have left or changed its pseudonym, or the receiver may have an outage.
A miss starts while the sender is silent if the vehicle ahead or behind is still received. Otherwise it starts when the
sender reappears, if other vehicles were received meanwhile. It never starts before `silence_timeout_s`: congestion
control may stretch the interval to 600 ms (SAE J2945/1).
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from headway.core.tracking.geodesy import metres_per_degree
from headway.core.types.batch import I64
from headway.core.types.records import Records

INTERVALS = 3.0
"""Silence, in mean intervals of the sender, after which it is overdue."""

PSEUDONYM_WITHIN_M, PSEUDONYM_TRAVEL_SHARE = 5.0, 0.2
"""A new vehicle within this distance of the extrapolated place of a silent one is that vehicle."""


@njit(cache=True, error_model="numpy")
def limit_us(interval_s: float, silence_timeout_s: float) -> int:
    """Return the silence (us) after which a sender of this interval is overdue."""
    return int(1e6 * max(silence_timeout_s, INTERVALS * interval_s))


@njit(cache=True, error_model="numpy")
def last_neighbour_us(last_received_us: I64, rows: I64, leaders: I64) -> I64:
    """Return, for each of `rows` (B,), the last receive time of its leader and followers; 0 without any.

    `last_received_us` is (C,), `leaders` (B,) the row of each one's leader, -1 for none.
    """
    neighbour = np.zeros(last_received_us.size, np.int64)
    for i in range(rows.size):
        if leaders[i] >= 0:
            neighbour[leaders[i]] = max(neighbour[leaders[i]], last_received_us[rows[i]])
    for i in range(rows.size):
        if leaders[i] >= 0:
            neighbour[rows[i]] = max(neighbour[rows[i]], last_received_us[leaders[i]])
    return neighbour[rows]


@njit(cache=True, error_model="numpy")
def overdue(
    tracks: Records,
    rows: I64,
    leaders: I64,
    ignored: NDArray[np.bool_],
    now_us: int,
    silence_timeout_s: float,
    warming_readings: int,
) -> NDArray[np.bool_]:
    """Return which of `rows` (B,) are silent beyond their limit while a neighbour was received since.

    `leaders` (B,) is the row of each one's leader, -1 for none; `ignored` (C,) are rows to skip.
    """
    neighbour_us = last_neighbour_us(tracks["received_us"], rows, leaders)
    found = np.zeros(rows.size, np.bool_)
    for i in range(rows.size):
        track = tracks[rows[i]]
        if ignored[rows[i]] or track.count <= warming_readings:
            continue
        limit = limit_us(track.interval_s, silence_timeout_s)
        found[i] = now_us - track.received_us > limit and neighbour_us[i] > track.received_us + limit // 2
    return found


@njit(cache=True, error_model="numpy")
def pseudonym_changed(tracks: Records, first_received_us: I64, silent_row: int, rows: I64) -> bool:
    """Whether one of `rows` (B,) that is new since is at the extrapolated place of the silent one: a new pseudonym."""
    track = tracks[silent_row]
    east_per_deg, north_per_deg = metres_per_degree(track.lat_deg)
    for i in range(rows.size):
        if first_received_us[rows[i]] <= track.received_us:
            continue
        other = tracks[rows[i]]
        ahead_m = track.v_mps * 1e-6 * (other.t_us - track.t_us)
        east_m = (other.lon_deg - track.lon_deg) * east_per_deg - ahead_m * track.heading_east
        north_m = (other.lat_deg - track.lat_deg) * north_per_deg - ahead_m * track.heading_north
        if math.hypot(east_m, north_m) < PSEUDONYM_WITHIN_M + PSEUDONYM_TRAVEL_SHARE * abs(ahead_m):
            return True
    return False


class ReceptionMonitor:
    """When any message was received, in buckets of 100 ms over the last minute: a receiver outage is not a miss."""

    BUCKET_US = 100_000
    BUCKETS = 600
    RECEIVING_SHARE = 0.8

    def __init__(self) -> None:
        self._received: I64 = np.zeros(self.BUCKETS, np.int64)
        self.outage_until_us = 0
        """Local time of the end of the last known outage."""

    def record(self, received_us: I64) -> None:
        """Record the receive times of a batch."""
        buckets = received_us // self.BUCKET_US
        self._received[buckets % self.BUCKETS] = buckets

    def ignore_gaps_before(self, until_us: int) -> None:
        """Treat all time before `until_us` as an outage."""
        self.outage_until_us = until_us

    def was_receiving(self, from_us: int, to_us: int) -> bool:
        """Whether messages came in most of the time strictly between two receive times, after any known outage."""
        buckets = np.arange(from_us // self.BUCKET_US + 1, to_us // self.BUCKET_US)[-self.BUCKETS :]
        if from_us < self.outage_until_us or buckets.size == 0:
            return False
        return bool((self._received[buckets % self.BUCKETS] == buckets).mean() >= self.RECEIVING_SHARE)
