"""One vehicle from an engine to another, in which rows and the origins of odometers differ."""

from typing import Any, TypeVar

import numpy as np

from headway.core.site.snapshots import copied, vehicle_tables
from headway.core.site.state import SiteState
from headway.core.tracking.pairing import NO_LEADER, leader_of
from headway.core.tracking.tracks import is_free
from headway.core.types.snapshot import OpenEvent
from headway.core.types.vehicle_state import Neighbours, VehicleState

_Of = TypeVar("_Of")
_SAME_ORIGIN_M = 1.0
"""Two odometers of one vehicle that agree within this have the same origin; the rest is noise of their estimates."""


def take_state(site: SiteState, vehicle: str) -> VehicleState | None:
    """Return the state of a vehicle; None if it is not known."""
    row = site.vehicles.row(vehicle)
    if row is None:
        return None
    tables, rows = site.tables, np.array([row])
    pair, tested = tables.pairing[row], int(tables.pair_tests[row]["leader"]) - 1
    leader, overlap = int(leader_of(tables.tracks, tables.pairing, row)), tables.tracks[row]["overlap"]
    event, pair_event = _first(site.events.snapshot(rows)), _first(site.pair_events.snapshot(rows))

    def name(other: int) -> str | None:
        return site.vehicles.id_of[other] if other >= 0 else None

    return VehicleState(
        vehicle=vehicle,
        tables={table: copied(of, rows) for table, of in vehicle_tables(site).items()},
        neighbours=Neighbours(
            leader=name(leader),
            candidate=name(int(pair["candidate_row"])),
            declared=name(int(site.declared_rows[row])),
            overlapped=name(int(overlap["row"]) - 1),
            tested=name(tested),
            suspect=name(event.suspect) if event is not None else None,
            pair_suspect=name(pair_event.suspect) if pair_event is not None else None,
        ),
        leader_place=(int(tables.tracks["t_us"][leader]), float(tables.tracks["x_m"][leader]))
        if leader >= 0
        else (0, 0.0),
        event=event,
        pair_event=pair_event,
        miss=_first(site.misses.snapshot(rows)),
        cleared_us=(site.events.cleared_us(row), site.pair_events.cleared_us(row)),
    )


def disown(site: SiteState, vehicle: str) -> None:
    """Leave a vehicle to another engine: its events are published there."""
    row = site.vehicles.row(vehicle)
    assert row is not None
    for log in (site.events, site.pair_events, site.misses):
        log.drop(row)
    site.tables.owned[row] = False


def adopt_state(site: SiteState, state: VehicleState, *, owned: bool) -> int | None:
    """Set the row of a vehicle from its state, and return it; None where no row is free."""
    known = site.vehicles.row(state.vehicle)
    admitted = [known] if known is not None else site.vehicles.admit([state.vehicle])
    if not admitted:
        return None
    row, tables, neighbours = admitted[0], site.tables, state.neighbours
    tracks, taken = tables.tracks, state.tables["tracks"][0]
    if known is not None and not is_free(tracks[row]):
        _move_followers(site, row, _shift_m(tracks[row], int(taken["t_us"]), float(taken["x_m"])))
        generation = int(tracks["generation"][row])
    else:
        generation = int(tracks["generation"][row]) + 1
    for name, table in vehicle_tables(site).items():
        table.view(np.uint8).reshape(table.size, -1)[row] = state.tables[name].view(np.uint8)

    def row_of(other: str | None) -> int:
        found = site.vehicles.row(other) if other is not None else None
        return NO_LEADER if found is None else found

    old = int(taken["generation"])
    tracks["generation"][row] = generation
    for table in (tables.pairing, tables.estimates, tables.earlier_estimates):
        table["generation"][row] = generation if table["generation"][row] == old else 0
    leader, pairing = row_of(neighbours.leader), tables.pairing
    pairing["leader_row"][row], pairing["candidate_row"][row] = leader, row_of(neighbours.candidate)
    if leader != NO_LEADER:
        pairing["leader_generation"][row] = tracks["generation"][leader]
        pairing["offset_m"][row] -= _shift_m(tracks[leader], *state.leader_place)
    site.declared_rows[row] = row_of(neighbours.declared)
    overlapped = row_of(neighbours.overlapped)
    tracks["overlap"]["row"][row] = overlapped + 1
    tracks["overlap"]["generation"][row] = tracks["generation"][overlapped] if overlapped != NO_LEADER else 0
    tables.pair_tests["leader"][row] = row_of(neighbours.tested) + 1
    site.evidence.clear(np.array([row]))
    _replace(site, row, state, row_of)
    tables.owned[row] = owned
    return row


def _replace(site: SiteState, row: int, state: VehicleState, row_of: Any) -> None:
    """Set the open events of a row."""
    neighbours, (cleared_us, pair_cleared_us) = state.neighbours, state.cleared_us

    def here(event: OpenEvent | None, suspect: str | None) -> OpenEvent | None:
        found = row_of(suspect)
        return event and event._replace(row=row, suspect=row if found == NO_LEADER else found)

    site.events.replace(row, here(state.event, neighbours.suspect), cleared_us)
    site.pair_events.replace(row, here(state.pair_event, neighbours.pair_suspect), pair_cleared_us)
    site.misses.drop(row)
    site.misses.restore([state.miss._replace(row=row)] if state.miss is not None else [])


def _shift_m(track: Any, t_us: int, x_m: float) -> float:
    """Return how far the odometer of `track` is ahead of one that shows `x_m` at event time `t_us`."""
    shift_m = float(track["x_m"] + 1e-6 * (t_us - track["t_us"]) * track["v_mps"] - x_m)
    return 0.0 if abs(shift_m) < _SAME_ORIGIN_M else shift_m


def _move_followers(site: SiteState, row: int, shift_m: float) -> None:
    """Keep the gap of those that follow `row`, whose odometer goes back by `shift_m`."""
    if shift_m:
        site.tables.pairing["offset_m"][site.tables.pairing["leader_row"] == row] += shift_m


def _first(of: list[_Of]) -> _Of | None:
    return of[0] if of else None
