"""From tracks and pairing to readings: each vehicle's own values and the newest estimate of its leader.

The leader's estimate excludes rejected readings.
"""

import numpy as np
from numba import njit
from numpy import float32

from headway.core.pipeline.estimates import estimate_before
from headway.core.pipeline.ordering import SLOT_US
from headway.core.pipeline.tables import Tables
from headway.core.tracking.coverage import is_appearing
from headway.core.tracking.overlap import is_named
from headway.core.tracking.pairing import NO_LEADER
from headway.core.types.batch import I64, Columns
from headway.core.types.records import READING, Records

LEADER_STALE_S = 1.0
"""A leader's estimate older than this, relative to the follower's reading, is not used: the road counts as free."""


@njit(cache=True, error_model="numpy")
def build_readings(tables: Tables, batch: Columns, rows: I64, places: I64, declared_rows: I64) -> tuple[Records, I64]:
    """Return one READING for each of `rows` (n,), and the row of its leader (NO_LEADER: none).

    `places` (n,) are the records' places in `batch` and in `declared_rows` (B,), the rows of the leaders that senders
    declare. A declared range counts only if it was measured to the leader of this row. What is declared is rounded to
    single precision, as `COMPACT_READING` keeps it.
    """
    tracks, readings, leaders = tables.tracks, np.empty(rows.size, READING), np.empty(rows.size, np.int64)
    for i in range(rows.size):
        track, z = tracks[rows[i]], readings[i]
        z.leader_t_s = z.leader_x_m = z.leader_v_mps = z.leader_length_m = z.range_m = z.range_rate_mps = np.nan
        z.t_s = 1e-6 * track.t_us
        z.x_m, z.odometer_std_m = track.x_m, float32(track.odometer_std_m)
        z.v_mps = track.v_mps
        z.east_m, z.north_m = track.step_east_m, track.step_north_m
        z.heading_deg, z.accuracy_m = float32(batch.heading_deg[places[i]]), float32(track.accuracy_m)
        z.overlapped, z.appeared = is_named(track), is_appearing(track)
        z.contradictions, track.contradictions = track.contradictions, 0
        pair, leaders[i] = tables.pairing[rows[i]], NO_LEADER
        if pair.leader_row == NO_LEADER or pair.generation != track.generation:
            continue
        newest, earlier = tables.estimates[pair.leader_row], tables.earlier_estimates[pair.leader_row]
        leader = estimate_before(newest, earlier, batch.received_us[places[i]] // SLOT_US)
        if leader.generation != pair.leader_generation:
            continue
        leaders[i] = pair.leader_row
        if abs(z.t_s - leader.t_s) > LEADER_STALE_S:
            continue
        z.leader_t_s, z.leader_x_m = leader.t_s, leader.x_m + pair.offset_m
        z.leader_v_mps, z.leader_length_m = leader.v_mps, float32(leader.length_m)
        if declared_rows[places[i]] == leaders[i]:
            z.range_m = float32(batch.range_m[places[i]])
            z.range_rate_mps = float32(batch.range_rate_mps[places[i]])
    return readings, leaders
