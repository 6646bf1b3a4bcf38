"""How people handle a vehicle with alerts: acknowledged, muted, resolved, and their notes.

A `HandlingRequest` is the payload of a query to `<prefix>/<site>/handling`. The service stores it, publishes the
`Handling` and replies with it. A query without a payload is answered with the newest handlings of each vehicle.
"""

from enum import StrEnum
from typing import Annotated, Final

from pydantic import Field, TypeAdapter

from headway_schemas.fields import Id, Message, TUs


class Action(StrEnum):
    """What a person does."""

    ACKNOWLEDGE = "acknowledge"
    """Somebody looks after the vehicle."""
    MUTE = "mute"
    """Nothing is sent about the vehicle until `until_us`; without it, until its open events have ended."""
    UNMUTE = "unmute"
    """Ends all of these."""
    RESOLVE = "resolve"
    """Done; a later event opens the matter again."""
    NOTE = "note"
    """A remark that changes nothing."""


class HandlingRequest(Message):
    """What a person asks for."""

    vehicle: Id
    action: Action
    by: Annotated[str, Field(min_length=1, max_length=64)]
    """Who, as they call themselves; it is not verified."""
    until_us: TUs | None = None
    """End of a mute."""
    note: Annotated[str, Field(max_length=500)] = ""


class Handling(HandlingRequest):
    """The same, as it is stored and published."""

    site: Id
    t_us: TUs
    """When the service stored it."""

    def is_in_force(self, *, onset_us: int, is_open: bool, now_us: int) -> bool:
        """Whether it applies to an event of the vehicle that began at `onset_us`."""
        match self.action:
            case Action.MUTE if self.until_us is None:
                return is_open and onset_us <= self.t_us
            case Action.MUTE:
                return now_us < (self.until_us or 0)
            case Action.RESOLVE:
                return onset_us <= self.t_us
            case Action.ACKNOWLEDGE:
                return True
            case _:
                return False


HANDLINGS: Final = TypeAdapter(list[Handling])
"""Reads the payload of a reply."""
