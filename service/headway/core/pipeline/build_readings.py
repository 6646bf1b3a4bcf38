"""From tracks and pairing to readings: each vehicle's own values and the newest estimate of its leader.

The leader's estimate excludes rejected readings. It is the estimate before this round, so the order of vehicles within
a round has no effect.
"""

import numpy as np
from numba import njit

from headway.core.pipeline.tables import Tables
from headway.core.tracking.pairing import NO_LEADER, leader_of
from headway.core.types.batch import I64, Columns
from headway.core.types.records import READING, Records

LEADER_STALE_S = 1.0
"""A leader's estimate older than this, relative to the follower's reading, is not used: the road counts as free."""


@njit(cache=True, error_model="numpy")
def build_readings(tables: Tables, batch: Columns, rows: I64, places: I64, declared_rows: I64) -> tuple[Records, I64]:
    """Return one READING for each of `rows` (n,), and the row of its leader (NO_LEADER: none).

    `places` (n,) are the records' places in `batch` and in `declared_rows` (B,), the rows of the leaders that senders
    declare. A declared range counts only if it was measured to the leader of this row.
    """
    tracks, readings, leaders = tables.tracks, np.empty(rows.size, READING), np.empty(rows.size, np.int64)
    for i in range(rows.size):
        track, z = tracks[rows[i]], readings[i]
        z.leader_t_s = z.leader_x_m = z.leader_v_mps = z.leader_length_m = z.range_m = z.range_rate_mps = np.nan
        z.t_s = 1e-6 * track.t_us
        z.x_m, z.odometer_std_m = track.x_m, track.odometer_std_m
        z.v_mps = track.v_mps
        z.east_m, z.north_m = track.step_east_m, track.step_north_m
        z.heading_deg, z.accuracy_m = batch.heading_deg[places[i]], track.accuracy_m
        z.contradictions, track.contradictions = track.contradictions, 0
        leader_row = leader_of(tracks, tables.pairing, rows[i])
        leaders[i] = leader_row
        if leader_row == NO_LEADER or abs(z.t_s - tables.verdict_t_s[leader_row]) > LEADER_STALE_S:
            continue
        z.leader_t_s = tables.verdict_t_s[leader_row]
        z.leader_x_m = tables.newest_verdicts[leader_row].x_m + tables.pairing[rows[i]].offset_m
        z.leader_v_mps = tables.newest_verdicts[leader_row].v_mps
        z.leader_length_m = tracks[leader_row].length_m
        if declared_rows[places[i]] == leader_row:
            z.range_m = batch.range_m[places[i]]
            z.range_rate_mps = batch.range_rate_mps[places[i]]
    return readings, leaders
