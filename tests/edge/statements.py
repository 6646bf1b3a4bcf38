"""Statements as the loop makes them, and a walk through the pages of their journal."""

import json
from pathlib import Path

from sim.rig import IDENTITY, KEYS
from stub import event

from headway.edge.codec import encode
from headway.edge.history import page
from headway.edge.journal import Statement
from headway.edge.outgoing import event_message
from headway_schemas.history import AlertsQuery


def statement(detected_us: int, **changes) -> Statement:
    message = event_message(event(**changes), IDENTITY, detected_us, {})
    return Statement(message, KEYS.alert(message.kind, message.suspect), encode(message))


def query(**asked) -> AlertsQuery:
    return AlertsQuery.from_parameters({name: str(value) for name, value in asked.items() if value is not None})


def found(path: Path, **asked) -> list[dict]:
    return [json.loads(told) for told in page(path, query(**asked), IDENTITY.site)]


def detected(path: Path, **asked) -> list[int]:
    return [told["detected_us"] for told in found(path, **asked)]
