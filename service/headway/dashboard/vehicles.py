"""Vehicles with events, one row for each suspect and site, as the page groups them."""

from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from headway.dashboard.event_summary import EventSummary
from headway.dashboard.notices import LAPSE_US
from headway.dashboard.view_state import ViewState
from headway_schemas import Kind, Phase, Sensor
from headway_schemas.handling import Action, Handling


@dataclass(frozen=True, slots=True)
class VehicleEvents:
    """A vehicle and what is known of its events."""

    site: str
    vehicle: str
    events: tuple[EventSummary, ...]
    open_kinds: tuple[Kind, ...]
    """Kinds of its open events, one for each."""
    decision: Handling | None
    """How a person handles it now."""

    @property
    def state(self) -> str:
        """`open`, `silent` where nothing but a miss is open, or `over`."""
        if not self.open_kinds:
            return "over"
        return "silent" if set(self.open_kinds) == {Kind.MISS} else "open"

    @property
    def count(self) -> int:
        """Anomalies that the events stand for."""
        return sum(event.newest.count for event in self.events)

    @property
    def first_us(self) -> int:
        """When the first event began."""
        return min(event.first_us for event in self.events)

    @property
    def last_us(self) -> int:
        """Time of the newest update."""
        return max(event.newest.detected_us for event in self.events)

    @property
    def deviation(self) -> tuple[float, float]:
        """Largest deviation of location (m) and speed (m/s), of events of that sensor; 0: none."""
        kept = [(event.newest.sensor, event) for event in self.events]
        x_m = [event.deviation_m or 0.0 for sensor, event in kept if sensor is not Sensor.SPEED]
        v_mps = [event.deviation_mps or 0.0 for sensor, event in kept if sensor is not Sensor.LOCATION]
        return max(x_m, default=0.0), max(v_mps, default=0.0)

    @property
    def urgency(self) -> tuple[Any, ...]:
        """Key of the order `worst`: muted vehicles last, then by state and by deviation."""
        handled = "" if self.decision is None else self.decision.action
        order = ("open", "silent", "over").index(self.state)
        return (
            handled == "mute",
            handled == "resolve",
            order,
            -max(self.deviation),
            -self.count,
            self.site,
            self.vehicle,
        )


ORDERS: Final[dict[str, Callable[[VehicleEvents], Any]]] = {
    "worst": lambda vehicle: vehicle.urgency,
    "newest": lambda vehicle: -vehicle.last_us,
    "most events": lambda vehicle: -vehicle.count,
    "name": lambda vehicle: (vehicle.site, vehicle.vehicle),
}
"""Keys to sort by, by the name of the order."""


def vehicles_of(view_state: ViewState, now_us: int, order: str = "worst") -> list[VehicleEvents]:
    """Return the vehicles of all known events, in one of the `ORDERS`."""
    grouped: dict[tuple[str, str], list[EventSummary]] = defaultdict(list)
    for event in view_state.events:
        grouped[event.newest.site, event.newest.suspect].append(event)
    found = [_vehicle(view_state, *key, events, now_us) for key, events in grouped.items()]
    return sorted(found, key=ORDERS[order])


def _vehicle(view_state: ViewState, site: str, vehicle: str, events: list[EventSummary], now_us: int) -> VehicleEvents:
    is_open = [e.newest.phase is not Phase.CLEARED and now_us - e.newest.detected_us < LAPSE_US for e in events]
    decision = view_state.handlings.get((site, vehicle, False))
    if decision is not None:
        reach = all if decision.action is Action.RESOLVE else any
        pairs = zip(events, is_open, strict=True)
        if not reach(decision.is_in_force(onset_us=e.first_us, is_open=opened, now_us=now_us) for e, opened in pairs):
            decision = None
    open_kinds = tuple(event.newest.kind for event, opened in zip(events, is_open, strict=True) if opened)
    return VehicleEvents(site, vehicle, tuple(events), open_kinds, decision)
