"""Statements as the loop makes them, and a walk through the pages of their journal."""

import json
from pathlib import Path

from edge.stub import event
from sim.rig import IDENTITY, KEYS

from headway.edge.codec.messages import Timing, encode, event_message
from headway.edge.storage.journal import EventUpdate
from headway.edge.storage.journal_query import page
from headway_schemas.encodings import J2735_RAW
from headway_schemas.event import Event, OriginalMessage, Phase
from headway_schemas.query import AlertsQuery


def update(detected_us: int, sequence: int = 1, **changes) -> EventUpdate:
    """Return an update that was detected then; unless told, with an `event_id` and `t_us` of its own."""
    of = {"event_id": f"e{detected_us}", "t_us": detected_us} | changes
    message = event_message(
        event(**of), IDENTITY, Timing(detected_us, 0, 0, 0), lambda suspect, t_us: (original(suspect, t_us),)
    )
    message = message.model_copy(update={"instance": IDENTITY.instance, "sequence": sequence})
    return EventUpdate(message, KEYS.alert(message.kind, message.suspect), encode(message))


def original(suspect: str, t_us: int) -> OriginalMessage:
    """Return a message that tells the journal nothing."""
    return OriginalMessage(received_us=t_us, encoding=J2735_RAW, payload=f'{{"id":"{suspect}"}},"checkpoint":'.encode())


def query(**asked) -> AlertsQuery:
    return AlertsQuery.from_parameters({name: str(value) for name, value in asked.items() if value is not None})


def found(path: Path, **asked) -> list[dict]:
    return [json.loads(published) for published in page(path, query(**asked), IDENTITY.site)]


def detected(path: Path, **asked) -> list[int]:
    return [published["detected_us"] for published in found(path, **asked)]


def stored(updates: list[Event]) -> list[Event]:
    """Return what the journal keeps of updates in their order: of each event the onset, the newest update, the end."""
    newest = {(event.event_id, event.phase): event for event in updates}
    ended = {event.event_id for event in updates if event.phase is Phase.CLEARED}
    kept = [event for event in newest.values() if not (event.phase is Phase.UPDATE and event.event_id in ended)]
    return sorted(kept, key=lambda event: event.sequence, reverse=True)
