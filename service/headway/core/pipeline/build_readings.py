"""From tracks and pairing to readings: each vehicle's own numbers beside the newest judged sample of its leader.

The leader's sample is its estimate, so that a rejected reading of the leader is not passed on; and it is the one of
before this wave, so that the order of vehicles within a wave is of no account.
"""

from typing import Any

import numpy as np
from numba import njit

from headway.core.tracking.pairing import NO_LEADER, leader_of
from headway.core.types.batch import F64, I64
from headway.core.types.records import Records

LEADER_STALE_S = 1.0
"""A leader's sample further in time from the follower's reading says nothing about now: the road is taken as free."""


@njit(cache=True)
def build_readings(
    tracks: Records,
    pairing: Records,
    verdict_t_s: F64,
    verdicts: Records,
    rows: I64,
    declared_rows: I64,
    round_places: I64,
    range_m: F64,
    range_rate_mps: F64,
    out_readings: Any,
    out_leaders: I64,
) -> None:
    """Fill one READING for each of `rows` (B,), and the row of its leader (NO_LEADER: none).

    `round_places` (B,) are their places in the batch's columns `declared_rows`, `range_m` and `range_rate_mps`.
    `verdicts` (C,) and `verdict_t_s` (C,) are each row's newest verdict and its event time. A declared range counts
    only if it was measured to the leader of this row.
    """
    for i in range(rows.size):
        track, z = tracks[rows[i]], out_readings[i]
        z.leader_t_s = z.leader_x_m = z.leader_v_mps = z.leader_length_m = z.range_m = z.range_rate_mps = np.nan
        z.t_s = 1e-6 * track.t_us
        z.x_m = track.x_m
        z.v_mps = track.v_mps
        leader_row = leader_of(tracks, pairing, rows[i])
        out_leaders[i] = leader_row
        if leader_row == NO_LEADER or abs(z.t_s - verdict_t_s[leader_row]) > LEADER_STALE_S:
            continue
        z.leader_t_s = verdict_t_s[leader_row]
        z.leader_x_m = verdicts[leader_row].x_m + pairing[rows[i]].offset_m
        z.leader_v_mps = verdicts[leader_row].v_mps
        z.leader_length_m = tracks[leader_row].length_m
        if declared_rows[round_places[i]] == leader_row:
            z.range_m = range_m[round_places[i]]
            z.range_rate_mps = range_rate_mps[round_places[i]]
