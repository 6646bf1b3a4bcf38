"""The state of a site as values, and back: a restarted service continues with the vehicles it knew."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from headway.core.site.state import SiteState
from headway.core.tracking.pairing import NO_LEADER
from headway.core.types.batch import I64
from headway.core.types.snapshot import Snapshot


def take_snapshot(site: SiteState, stride: int, phase: int) -> Snapshot:
    """Return copies of the state of the vehicles of one part (`SiteState.rows`)."""
    rows = site.owned_rows(stride, phase)
    return Snapshot(
        rows=rows,
        ids=[str(site.vehicles.id_of[row]) for row in rows],
        tables={name: copied(table, rows) for name, table in vehicle_tables(site).items()},
        events=site.events.snapshot(rows),
        pair_events=site.pair_events.snapshot(rows),
        misses=site.misses.snapshot(rows),
    )


def restore_snapshot(site: SiteState, snapshot: Snapshot, now_us: int) -> int:
    """Restore the vehicles of a snapshot; return how many.

    A vehicle is left out whose last message is `vehicle_ttl_s` older than the newest of the snapshot. The site must be
    empty, and the snapshot must come from its configuration and from this version of the core. No vehicle is silent
    before `now_us`, because the service did not receive then.
    """
    received_us, in_use = snapshot.tables["tracks"]["received_us"], site.vehicles.in_use
    newest = np.argsort(received_us, kind="stable")[::-1]
    _, first = np.unique(np.array(snapshot.ids, dtype=np.str_)[newest], return_index=True)
    kept = newest[first]
    newest_us = received_us.max(initial=0)
    kept = np.sort(kept[newest_us - received_us[kept] <= site.config.vehicle_ttl_s * 1e6])
    rows = snapshot.rows[kept]
    site.vehicles.restore(rows, [snapshot.ids[i] for i in kept])
    for name, table in vehicle_tables(site).items():
        table[rows] = snapshot.tables[name][kept]
    for column in ("leader_row", "candidate_row"):
        other = site.tables.pairing[column][rows]
        site.tables.pairing[column][rows] = np.where(in_use[other], other, NO_LEADER)
    for log, events in ((site.events, snapshot.events), (site.pair_events, snapshot.pair_events)):
        of = [event for event in events if in_use[event.row]]
        log.restore([event if in_use[event.suspect] else event._replace(suspect=event.row) for event in of])
    site.misses.restore([miss for miss in snapshot.misses if in_use[miss.row]])
    site.reception.absent_until(now_us)
    return int(rows.size)


def copied(table: NDArray[Any], rows: I64) -> NDArray[Any]:
    """Return a copy of the rows, byte by byte: numpy leaves the bytes between two fields undefined."""
    return table.view(np.uint8).reshape(table.size, -1)[rows].reshape(-1).view(table.dtype)


def vehicle_tables(site: SiteState) -> dict[str, NDArray[Any]]:
    """Return the tables that a snapshot holds, by name."""
    tables = site.tables
    return {
        "tracks": tables.tracks,
        "pairing": tables.pairing,
        "bank": tables.bank,
        "verdicts": tables.newest_verdicts,
        "estimates": tables.estimates,
        "earlier_estimates": tables.earlier_estimates,
        "first_received_us": site.first_received_us,
        "declared_rows": site.declared_rows,
    }
