"""Messages for the tests of the codec."""

import json
from typing import Any

import msgpack

from headway.core.types.batch import Ids
from headway.edge.transport.message import ReceivedMessage
from headway_schemas import Keys
from headway_schemas.bsm import FIELDS
from headway_schemas.encodings import BSM_MSGPACK

KEYS = Keys("v2x", "s")
RECEIVED_US = 1_700_000_000_000_000
GATEWAY = "gw-1"


def record(sender: str = "a", **changes: Any) -> list[Any]:
    """Return a compact record that is right, with some fields changed."""
    fields = dict.fromkeys(FIELDS) | {
        "v": 1,
        "id": sender,
        "msg_cnt": 7,
        "t_us": RECEIVED_US - 20_000,
        "lat": 42.3,
        "lon": -83.7,
        "speed_mps": 13.5,
        "heading_deg": 90.0,
    }
    return list((fields | changes).values())


def as_map(fields: list[Any]) -> dict[str, Any]:
    """Return the map that says the same."""
    message = {name: value for name, value in zip(FIELDS, fields, strict=True) if value is not None}
    if isinstance(message.get("leader"), list):
        message["leader"] = dict(zip(("id", "range_m", "range_rate_mps"), message["leader"], strict=False))
    return message


def received(
    content: Any, sender: str = "a", encoding: str = BSM_MSGPACK, *, key: str | None = None, is_put: bool = True
) -> ReceivedMessage:
    """Wrap content, bytes or something to encode, as it comes from the bus."""
    if isinstance(content, bytes):
        payload = content
    elif encoding == BSM_MSGPACK:
        payload = msgpack.packb(content)
    else:
        payload = json.dumps(content).encode()
    return ReceivedMessage(key or KEYS.bsm(sender), payload, encoding, is_put, RECEIVED_US, 0)


def ids_of(column: Ids) -> list[str | None]:
    """Read a column of identifiers; None where there is none."""
    return [name.decode() or None for name in column.tolist()]
