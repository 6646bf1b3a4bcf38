"""One message out of the payload that carried it."""

import json
from typing import Any

import msgpack

from headway.feeds.j2735_json import messages_in
from headway.feeds.json_text import parsed
from headway_schemas.encodings import BSM_JSON, BSM_MSGPACK, CAM_UPER, J2735_UPER
from headway_schemas.event import OriginalMessage
from headway_schemas.frames import Frame, is_bundle


def original_of(payload: bytes, encoding: str, index: int, received_us: int) -> OriginalMessage:
    """Return the message with record `index` of a payload that was decoded, as it came where that is possible.

    A frame of a gateway comes with its own time of reception. A record of another bundle is encoded again by itself.
    """
    if encoding == BSM_MSGPACK:
        content = msgpack.unpackb(payload)
        payload = msgpack.packb(content[index]) if _is_bundle(content) else payload
    elif encoding == BSM_JSON:
        content = json.loads(payload)
        payload = json.dumps(content[index]).encode() if _is_bundle(content) else payload
    elif is_bundle(payload):
        frame = Frame(*_frame_of(msgpack.unpackb(payload), encoding, index))
        payload, received_us = frame.payload, frame.received_us
    elif payload.lstrip()[:1] == b"[":
        payload = json.dumps(messages_in(parsed(payload))[index]).encode()
    return OriginalMessage(received_us=received_us, encoding=encoding, payload=payload)


def _is_bundle(content: Any) -> bool:
    return isinstance(content, list) and isinstance(content[0], list | dict)


def _frame_of(frames: list[Any], encoding: str, index: int) -> Any:
    """Return the frame with a record; a frame of JSON may hold several, and one that is no JSON counts once."""
    if encoding in (J2735_UPER, CAM_UPER):
        return frames[index]
    for frame in frames:
        index -= _messages_of(frame[0])
        if index < 0:
            break
    return frame


def _messages_of(payload: bytes) -> int:
    try:
        return len(messages_in(parsed(payload))) or 1
    except (ValueError, RecursionError):
        return 1
