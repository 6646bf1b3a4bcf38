"""The view of a site for the state topic and for queries."""

import numpy as np

from headway.core.site.state import SiteState
from headway.core.tracking.pairing import gaps_m
from headway.core.types.step_result import PairStates


def pair_states(site: SiteState, stride: int, phase: int) -> PairStates:
    """Return the vehicles whose row is `phase` modulo `stride`, as columns."""
    tables, rows, ids = site.tables, site.owned_rows(stride, phase), site.vehicles.id_of
    track, verdict = tables.tracks[rows], tables.newest_verdicts[rows]
    leaders, gap_m = site.leaders(rows), np.empty(rows.size)
    gaps_m(tables.tracks, tables.pairing, rows, gap_m)
    return PairStates(
        followers=[str(ids[row]) for row in rows],
        leaders=[ids[row] if row >= 0 else None for row in leaders],
        t_us=track["t_us"],
        lat_deg=track["lat_deg"],
        lon_deg=track["lon_deg"],
        heading_deg=np.degrees(np.arctan2(track["heading_east"], track["heading_north"])) % 360.0,
        gap_m=gap_m,
        x_m=verdict["x_m"],
        offset_m=track["x_m"] - verdict["x_m"],
        v_mps=verdict["v_mps"],
        statistic=verdict["statistic"],
        gate=verdict["gate"],
        nis=verdict["nis"],
        warming=verdict["warming"],
        anomalous=site.events.active[rows] | site.pair_events.active[rows],
        silent=site.misses.active[rows],
    )
