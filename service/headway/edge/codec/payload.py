"""From the bytes of one payload to compact records, for every encoding that the service reads.

Sizes are bounded before memory is allocated, and what cannot be read becomes a `RejectReason`. A record that comes out
is not validated yet: it may be any object.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, NamedTuple, TypeVar

import msgpack

from headway.core.types.outcome import Outcome
from headway.edge.transport.message import RejectReason
from headway.feeds.cam_json import from_cam
from headway.feeds.j2735_json import from_ode, from_raw, messages_in
from headway.feeds.json_text import parsed_strictly, without_duplicates
from headway.feeds.kinds import kind_of
from headway.feeds.refusal import Refusal, Result
from headway_schemas.bsm import FIELDS, LEADER_FIELDS, WIRE_VERSION
from headway_schemas.encodings import (
    BSM_JSON,
    BSM_MSGPACK,
    CAM_JSON,
    CAM_UPER,
    J2735_ODE,
    J2735_RAW,
    J2735_UPER,
)
from headway_schemas.frames import Frame, is_bundle, unpack

_MAP_MAX: Final = 64
"""Entries of the largest map in a msgpack payload: a message has fourteen."""
_FIELD_SET: Final = frozenset(FIELDS)
_LEADER_FIELD_SET: Final = frozenset(LEADER_FIELDS)

Records = list[Any]
"""Compact records; a `RejectReason` or another object where the sender sent no record."""
_JSON_FEEDS: Final[dict[str, Callable[[object, int], Result]]] = {
    J2735_RAW: from_raw,
    J2735_ODE: from_ode,
    CAM_JSON: from_cam,
}
UPER_FEEDS: Final = (J2735_UPER, CAM_UPER)


class RejectedPayload(NamedTuple):
    """A payload without a record that can be decoded."""

    reason: RejectReason
    size: int = 1
    """Records in it; one where they cannot be counted."""


_Item = TypeVar("_Item")


class _BundleTooLargeError(Exception):
    def __init__(self, size: int) -> None:
        super().__init__(size)
        self.size = size


class Reader:
    """Reads payloads of every encoding, bundles of at most `bundle_max` records."""

    def __init__(self, bundle_max: int) -> None:
        self._bundle_max = bundle_max
        self._array_max = max(bundle_max, len(FIELDS))
        self._readers: dict[str, Callable[[bytes, int], Records]] = {
            BSM_MSGPACK: self._read_msgpack,
            BSM_JSON: self._read_json,
            **{encoding: self._json_feed(convert) for encoding, convert in _JSON_FEEDS.items()},
        }

    def read(self, payload: bytes, encoding: str, received_us: int) -> Records | RejectedPayload:
        """Return the records of a payload, at least one, in order."""
        reader = self._readers.get(encoding)
        if reader is None:
            return RejectedPayload(
                RejectReason(
                    Outcome.UNKNOWN_ENCODING, "encoding is none of " + ", ".join((*self._readers, *UPER_FEEDS))
                )
            )
        return self._bounded(lambda: reader(payload, received_us), encoding)

    def frames(self, payload: bytes, encoding: str, received_us: int) -> list[Frame] | RejectedPayload:
        """Return the binary messages of a payload: one, or those of a bundle."""
        if not is_bundle(payload):
            return [Frame(payload, received_us, "")]
        return self._bounded(lambda: self._unpacked(payload), encoding)

    def _bounded(self, read: Callable[[], list[_Item]], encoding: str) -> list[_Item] | RejectedPayload:
        try:
            return read()
        except _BundleTooLargeError as error:
            reason = RejectReason(Outcome.BUNDLE_TOO_LARGE, f"{error.size} records, at most {self._bundle_max}")
            return RejectedPayload(reason, error.size)
        except (ValueError, RecursionError):
            return RejectedPayload(RejectReason(Outcome.MALFORMED, f"not {encoding}"))

    def _read_msgpack(self, payload: bytes, _received_us: int) -> Records:
        try:
            content = msgpack.unpackb(
                payload, max_array_len=self._array_max, max_map_len=_MAP_MAX, object_pairs_hook=without_duplicates
            )
        except ValueError:
            size = _msgpack_array_size(payload)
            if self._array_max < size <= len(payload):
                raise _BundleTooLargeError(size) from None
            raise
        return self._records(content)

    def _read_json(self, payload: bytes, _received_us: int) -> Records:
        return self._records(json.loads(payload.decode("utf-8"), object_pairs_hook=without_duplicates))

    def _json_feed(self, convert: Callable[[object, int], Result]) -> Callable[[bytes, int], Records]:
        def converted(payload: bytes, received_us: int) -> Records:
            return [_record_or_reason(convert(message, received_us)) for message in self._messages(payload)]

        def read(payload: bytes, received_us: int) -> Records:
            if not is_bundle(payload):
                return converted(payload, received_us)
            records: Records = []
            for frame in self._unpacked(payload):
                try:
                    records += converted(frame.payload, frame.received_us)
                except (ValueError, RecursionError):
                    records.append(RejectReason(Outcome.MALFORMED, "a frame that is not JSON"))
            self._require_size(records)
            return records

        return read

    def _records(self, content: Any) -> Records:
        if type(content) is list and content:
            head = type(content[0])
            if head is not list and head is not dict:
                return [content]
            self._require_size(content)
            return [record_of(item) if type(item) is dict else item for item in content]
        if type(content) is dict:
            return [record_of(content)]
        raise ValueError("neither a message nor a bundle of messages")

    def _messages(self, payload: bytes) -> list[Any]:
        messages = messages_in(parsed_strictly(payload))
        if not messages:
            raise ValueError("no message")
        self._require_size(messages)
        return messages

    def _unpacked(self, payload: bytes) -> list[Frame]:
        size = _msgpack_array_size(payload)
        if self._bundle_max < size <= len(payload):
            raise _BundleTooLargeError(size)
        frames = unpack(payload, self._bundle_max)
        if not frames:
            raise ValueError("no frame")
        return frames

    def _require_size(self, bundle: Sequence[object]) -> None:
        if len(bundle) > self._bundle_max:
            raise _BundleTooLargeError(len(bundle))


def reason_of(refusal: Refusal) -> RejectReason:
    """Return a refusal of a feed as the service's own."""
    return RejectReason(Outcome[refusal.reason.upper()], refusal.detail)


def _record_or_reason(result: Result) -> list[Any] | RejectReason:
    return reason_of(result) if isinstance(result, Refusal) else result


def record_of(message: Mapping[str, Any]) -> list[Any] | RejectReason:
    """Return the compact record of a map; a `RejectReason` where its fields are not those of version 1."""
    if not _FIELD_SET.issuperset(message):
        if "t_us" not in message and (kind := kind_of(message)) is not None:
            return RejectReason(Outcome.OTHER_MESSAGE, kind)
        return shape_reason(message.get("v"), "a field that version 1 does not have")
    record = list(map(message.get, FIELDS))
    leader = record[-1]
    if leader is not None:
        if type(leader) is not dict or not _LEADER_FIELD_SET.issuperset(leader):
            return shape_reason(record[0], "the leader of a map is a map of id, range_m and range_rate_mps")
        record[-1] = list(map(leader.get, LEADER_FIELDS))
    return record


def shape_reason(version: object, detail: str) -> RejectReason:
    """Return the reason for a record with other fields: wrong version where `v` differs, else malformed."""
    if type(version) is int and version != WIRE_VERSION:
        return RejectReason(Outcome.WRONG_VERSION, f"v is not {WIRE_VERSION}")
    return RejectReason(Outcome.MALFORMED, detail)


def _msgpack_array_size(payload: bytes) -> int:
    """Return the size in the header of a long msgpack array, 0 for anything else."""
    if payload[:1] == b"\xdc":
        return int.from_bytes(payload[1:3], "big")
    if payload[:1] == b"\xdd":
        return int.from_bytes(payload[1:5], "big")
    return 0
