"""Misses: a sender that has stopped, detected by its own interval and by its neighbours.

Silence alone proves nothing. The vehicle may have left or changed its pseudonym, the channel may lose messages, or the
receiver may have an outage. A miss starts while the sender is silent if the vehicle ahead is still received, or the one
behind where the site receives vehicles further along. Otherwise it starts when the sender reappears, if other vehicles
were received meanwhile; its counter then tells a pause from a loss. It never starts before `silence_timeout_s`:
congestion control may stretch the interval to 600 ms (SAE J2945/1).
"""

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from headway.core.tracking.coverage import is_covered_beyond
from headway.core.tracking.geodesy import metres_per_degree
from headway.core.types.batch import I64
from headway.core.types.records import Records

INTERVALS = 3.0
"""Silence, in mean intervals of the sender, after which it is overdue;"""
LONGEST_INTERVALS = 2.0
"""and in its longest interval of late, for senders that send by triggers (ETSI EN 302 637-2)."""
BURST = 10.0
"""Messages that may be lost in a row on a channel that lost none before: two bursts of five."""
TRIGGERED_S, TRIGGERED_PAUSE_S = 0.15, 1.1
"""A sender whose longest interval exceeds the first may send by triggers, and then pause for the second."""
CHANCE = 1e-6
"""Probability that a silence is an accident of the channel, below which it is not taken for one."""
_LOSS_MOST = 0.97

PSEUDONYM_WITHIN_M, PSEUDONYM_TRAVEL_SHARE = 5.0, 0.2
"""A new vehicle within this distance of the extrapolated place of a silent one is that vehicle."""


@njit(cache=True, error_model="numpy")
def pause_limit_us(track: Any, silence_timeout_s: float) -> int:
    """Return the pause (us) after which a sender whose counter shows no loss was overdue."""
    pause_s = max(silence_timeout_s + 1.5 * track.interval_s, INTERVALS * track.interval_s)
    pause_s = max(pause_s, LONGEST_INTERVALS * track.longest_interval_s)
    if track.longest_interval_s > TRIGGERED_S:
        pause_s = max(pause_s, TRIGGERED_PAUSE_S)
    return int(1e6 * pause_s)


@njit(cache=True, error_model="numpy")
def limit_us(track: Any, silence_timeout_s: float) -> int:
    """Return the silence (us) after which a sender is overdue, for all that is known of the channel.

    The channel loses the next message with the probability that it lost those of late; once it loses, it goes on for
    the longest run of losses of late on average (Gilbert's model).
    """
    stays_lost = max(track.loss, 1.0 - 1.0 / max(track.longest_loss, 1.0))
    lost = BURST
    if stays_lost > 0.0:
        lost = max(lost, math.log(CHANCE) / math.log(min(stays_lost, _LOSS_MOST)))
    return max(pause_limit_us(track, silence_timeout_s), int(1e6 * (lost + 1.5) * track.interval_s))


@njit(cache=True, error_model="numpy")
def last_neighbour_us(last_received_us: I64, rows: I64, leaders: I64, covered: NDArray[np.bool_]) -> I64:
    """Return, for each of `rows` (B,), the last receive time of its leader and followers; 0 without any.

    A leader is received further along the road. A follower counts where the road ahead is `covered` (C,).

    `last_received_us` is (C,), `leaders` (B,) the row of each one's leader, -1 for none.
    """
    neighbour = np.zeros(last_received_us.size, np.int64)
    for i in range(rows.size):
        if leaders[i] >= 0 and covered[leaders[i]]:
            neighbour[leaders[i]] = max(neighbour[leaders[i]], last_received_us[rows[i]])
    for i in range(rows.size):
        if leaders[i] >= 0:
            neighbour[rows[i]] = max(neighbour[rows[i]], last_received_us[leaders[i]])
    return neighbour[rows]


@njit(cache=True, error_model="numpy")
def overdue(
    tracks: Records,
    coverage: Records,
    rows: I64,
    leaders: I64,
    ignored: NDArray[np.bool_],
    now_us: int,
    silence_timeout_s: float,
    warming_readings: int,
) -> NDArray[np.bool_]:
    """Return which of `rows` (B,) are silent beyond their limit while a neighbour was received since.

    `leaders` (B,) is the row of each one's leader, -1 for none; `ignored` (B,) are those to skip.
    """
    found, covered = np.zeros(rows.size, np.bool_), np.zeros(tracks.size, np.bool_)
    for i in range(rows.size):
        track = tracks[rows[i]]
        silent_us = now_us - track.received_us
        found[i] = not ignored[i] and track.count > warming_readings
        found[i] &= silent_us > limit_us(track, silence_timeout_s)
        covered[rows[i]] = found[i] and is_covered_beyond(coverage, track, 1e-6 * silent_us)
    if found.any():
        neighbour_us = last_neighbour_us(tracks["received_us"], rows, leaders, covered)
        for i in range(rows.size):
            track = tracks[rows[i]]
            found[i] &= neighbour_us[i] > track.received_us + limit_us(track, silence_timeout_s) // 2
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
    PAUSE_US = 1_000_000

    def __init__(self) -> None:
        self._received: I64 = np.zeros(self.BUCKETS, np.int64)
        self.outage_until_us = 0
        """Local time of the end of the last known outage."""
        self.absent_until_us = 0
        """Local time until which the service could not receive at all."""
        self.receiving_since_us = 0
        """Receive time of the first message after the last second without any."""
        self._newest_us = 0

    def record(self, received_us: I64) -> None:
        """Record the receive times of a batch."""
        first_us, newest_us = int(received_us[0]), self._newest_us
        self._newest_us = int(received_us[-1])
        if not 0 <= first_us - newest_us < self.PAUSE_US:
            self.receiving_since_us = first_us
        elif self._newest_us // self.BUCKET_US == newest_us // self.BUCKET_US:
            return
        buckets = received_us // self.BUCKET_US
        self._received[buckets % self.BUCKETS] = buckets

    def ignore_gaps_before(self, until_us: int) -> None:
        """Treat all time before `until_us` as an outage."""
        self.outage_until_us = until_us

    def absent_until(self, until_us: int) -> None:
        """Treat all time before `until_us` as an absence of the service: no vehicle is silent for it."""
        self.outage_until_us = self.absent_until_us = until_us

    def was_receiving(self, from_us: int, to_us: int) -> bool:
        """Whether messages came in most of the time strictly between two receive times, after any known outage."""
        buckets = np.arange(from_us // self.BUCKET_US + 1, to_us // self.BUCKET_US)[-self.BUCKETS :]
        if from_us < self.outage_until_us or buckets.size == 0:
            return False
        return bool((self._received[buckets % self.BUCKETS] == buckets).mean() >= self.RECEIVING_SHARE)
