"""From the bytes of one payload to compact records, for every encoding that the service reads.

Sizes are bounded before memory is allocated, and what cannot be read becomes a `RejectReason`. A record that comes out
is not validated yet: it may be any object.
"""

import json
from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple

import msgpack

from headway.core.types.outcome import Outcome
from headway.edge.codec import j2735
from headway.edge.transport.message import RejectReason
from headway_schemas.bsm import FIELDS, LEADER_FIELDS, WIRE_VERSION
from headway_schemas.encodings import BSM_JSON, BSM_MSGPACK, J2735_ODE, J2735_RAW

_MAP_MAX: Final = 64
"""Entries of the largest map in a msgpack payload: a message has fourteen."""
_FIELD_SET: Final = frozenset(FIELDS)
_LEADER_FIELD_SET: Final = frozenset(LEADER_FIELDS)

Records = list[Any]
"""Compact records; a `RejectReason` or another object where the sender sent no record."""


class RejectedPayload(NamedTuple):
    """A payload without a record that can be decoded."""

    reason: RejectReason
    size: int = 1
    """Records in it; one where they cannot be counted."""


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
            J2735_RAW: self._read_j2735_raw,
            J2735_ODE: self._read_j2735_ode,
        }

    def read(self, payload: bytes, encoding: str, received_us: int) -> Records | RejectedPayload:
        """Return the records of a payload, at least one, in order."""
        reader = self._readers.get(encoding)
        if reader is None:
            return RejectedPayload(
                RejectReason(Outcome.UNKNOWN_ENCODING, "encoding is none of " + ", ".join(self._readers))
            )
        try:
            return reader(payload, received_us)
        except _BundleTooLargeError as error:
            reason = RejectReason(Outcome.BUNDLE_TOO_LARGE, f"{error.size} records, at most {self._bundle_max}")
            return RejectedPayload(reason, error.size)
        except (ValueError, RecursionError):
            return RejectedPayload(RejectReason(Outcome.MALFORMED, f"not {encoding}"))

    def _read_msgpack(self, payload: bytes, _received_us: int) -> Records:
        try:
            content = msgpack.unpackb(
                payload, max_array_len=self._array_max, max_map_len=_MAP_MAX, object_pairs_hook=_without_duplicates
            )
        except ValueError:
            size = _msgpack_array_size(payload)
            if self._array_max < size <= len(payload):
                raise _BundleTooLargeError(size) from None
            raise
        return self._records(content)

    def _read_json(self, payload: bytes, _received_us: int) -> Records:
        return self._records(_json(payload))

    def _read_j2735_raw(self, payload: bytes, received_us: int) -> Records:
        return [j2735.from_raw(message, received_us) for message in self._messages(payload)]

    def _read_j2735_ode(self, payload: bytes, received_us: int) -> Records:
        return [j2735.from_ode(message, received_us) for message in self._messages(payload)]

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
        content = _json(payload)
        if type(content) is not list:
            return [content]
        if not content:
            raise ValueError("no message")
        self._require_size(content)
        return content

    def _require_size(self, bundle: list[Any]) -> None:
        if len(bundle) > self._bundle_max:
            raise _BundleTooLargeError(len(bundle))


def record_of(message: Mapping[str, Any]) -> list[Any] | RejectReason:
    """Return the compact record of a map; a `RejectReason` where its fields are not those of version 1."""
    if not _FIELD_SET.issuperset(message):
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


def _json(payload: bytes) -> Any:
    return json.loads(payload.decode("utf-8"), object_pairs_hook=_without_duplicates)


def _without_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    fields = dict(pairs)
    if len(fields) != len(pairs):
        raise ValueError("a field twice")
    return fields


def _msgpack_array_size(payload: bytes) -> int:
    """Return the size in the header of a long msgpack array, 0 for anything else."""
    if payload[:1] == b"\xdc":
        return int.from_bytes(payload[1:3], "big")
    if payload[:1] == b"\xdd":
        return int.from_bytes(payload[1:5], "big")
    return 0
