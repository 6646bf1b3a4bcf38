"""Queries for the history of events, the queryable `alerts` of a site.

The selector's parameters are the fields of `AlertsQuery`. The reply is one JSON array of events, newest first by
`detected_us`. A page never splits one microsecond: events with the `detected_us` of the last one come
too. So the next page is `before_us` of that one, and no event is skipped or repeated.
"""

from collections.abc import Mapping
from typing import Annotated, Final, Self

from pydantic import Field, TypeAdapter

from headway_schemas.event import Event, EventId, Kind, Phase
from headway_schemas.fields import Id, Message, TUs

LIMIT_MAX: Final = 1000

EVENTS: Final = TypeAdapter(list[Event])
"""Reads the payload of a reply."""


class AlertsQuery(Message):
    """Conditions on event updates; the result meets all that are given."""

    from_us: TUs | None = None
    """Detected at this instant or later."""
    to_us: TUs | None = None
    """Detected before this instant."""
    before_us: TUs | None = None
    """Where the page before this one ended."""
    kind: Kind | None = None
    phase: Phase | None = None
    """Updates of this phase."""
    vehicle: Id | None = None
    """Suspect, follower or leader."""
    vehicle_part: Id | None = None
    """The same, where a part of the id is enough."""
    event: EventId | None = None
    """Every update of this `event_id`."""
    instance: Id | None = None
    """Published by this instance."""
    after_sequence: Annotated[int, Field(ge=0)] | None = None
    """Of a higher `sequence`: what a subscriber has not received."""
    limit: Annotated[int, Field(ge=1, le=LIMIT_MAX)] = 100
    newest: bool = False
    """Whether only the newest update of each event is meant: one row for each event, as it is known now."""
    evidence: bool = False
    """Whether the evidence comes along; a list is lighter without."""

    @classmethod
    def from_parameters(cls, parameters: Mapping[str, str]) -> Self:
        """Read a selector's parameters. Raises `pydantic.ValidationError` for an unknown or unfit one."""
        return cls.model_validate_strings(dict(parameters))

    def to_parameters(self) -> str:
        """Write the parameters of a selector, without those at their default."""
        fields = self.model_dump(mode="json", exclude_defaults=True)
        return ";".join(f"{name}={value}" for name, value in fields.items())
