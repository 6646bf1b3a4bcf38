"""Bytes of received messages to the columns of a batch.

A batch of compact msgpack records is decoded in one compiled pass (`msgpack_columns`). Any other batch is decoded
payload by payload and then validated by column. Only a record that fails there goes to the model, which names the
reason. Each record of each payload ends in the batch or in exactly one rejection.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain, repeat
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError
from pydantic_core import ErrorDetails

from headway.core.types.batch import F64, Ids
from headway.core.types.identifiers import ID_BYTES, id_column
from headway.core.types.outcome import Outcome
from headway.edge.codec import msgpack_columns
from headway.edge.codec.decoded import (
    ANY_SENDER,
    NOT_THE_SENDER,
    Decoded,
    DecodedRecords,
    batch_of,
    indices_in,
    joined,
    may_send,
    received_us_of,
)
from headway.edge.codec.layout import Layout
from headway.edge.codec.msgpack_columns import CompactRecords
from headway.edge.codec.payload import Reader, RejectedPayload, shape_reason
from headway.edge.codec.uper_batch import UPER_READERS, UperFrames
from headway.edge.transport.message import ReceivedMessage, Rejection, RejectReason
from headway.feeds.identifiers import folded
from headway_schemas.bsm import Bsm, Leader, from_record
from headway_schemas.encodings import BSM_MSGPACK, J2735_ODE, J2735_RAW
from headway_schemas.keys import Keys, has_wildcard, is_gateway, is_id

_CACHED_MAX: Final = 100_000
"""Most valid keys, and most valid identifiers, in the caches; a full cache is cleared."""

_BSM: Final = Layout.of(Bsm)
_LEADER: Final = Layout.of(Leader)

_J2735_JSON: Final = (J2735_RAW, J2735_ODE)

_NOTHING: Final[list[Any]] = []
"""A record without fields, which no model accepts."""

_REASONS: Final = {
    "missing": Outcome.UNAVAILABLE,
    "finite_number": Outcome.NOT_FINITE,
    "greater_than": Outcome.OUT_OF_RANGE,
    "greater_than_equal": Outcome.OUT_OF_RANGE,
    "less_than": Outcome.OUT_OF_RANGE,
    "less_than_equal": Outcome.OUT_OF_RANGE,
    "value_error": Outcome.OUT_OF_RANGE,
}
"""Error types of the model and our reasons; every other type is malformed."""
_WORST_FIRST: Final = (
    Outcome.WRONG_VERSION,
    Outcome.MALFORMED,
    Outcome.NOT_FINITE,
    Outcome.UNAVAILABLE,
    Outcome.OUT_OF_RANGE,
)
"""Of several errors in one record, the first of these names it."""


@dataclass(frozen=True, slots=True)
class _Opened:
    """The payloads that could be read: all their records, and (P,) the message of each payload."""

    records: list[Any]
    sources: list[int]
    sizes: list[int]
    """Records of the payload."""
    owners: list[str]
    """The only sender allowed for these records; empty for a gateway."""


class Codec:
    """Reads the messages of one site.

    Parameters
    ----------
    keys
        Keys of the site.
    payload_max_bytes
        Size of the largest payload that is decoded.
    bundle_max
        Records of the largest bundle.
    """

    def __init__(self, keys: Keys, *, payload_max_bytes: int = 65_536, bundle_max: int = 512) -> None:
        self._keys = keys
        self._payload_max_bytes = payload_max_bytes
        self._bundle_max = bundle_max
        self._clock_offset_us = 0
        self._reader = Reader(bundle_max)
        self._owners: dict[str, bytes] = {}
        """Owner by key, padded."""
        self._ids: set[str] = set()

    def decode(self, messages: Sequence[ReceivedMessage], clock_offset_us: int = 0) -> Decoded:
        """Decode messages to a batch, in order, and name the reason for each rejected record; never raises.

        `clock_offset_us` takes the local receive time to Unix time.
        """
        self._clock_offset_us = clock_offset_us
        return self._decode_compact(messages) or self._decode_by_form(messages)

    def warm_up(self) -> None:
        """Compile or load the kernels."""
        msgpack_columns.read(b"", np.empty(0, np.int64), b"", self._bundle_max)
        for read in UPER_READERS.values():
            read([b"\0"], np.zeros(1, np.int64))

    def _decode_compact(self, messages: Sequence[ReceivedMessage]) -> Decoded | None:
        """Decode valid compact records under known keys; None if a message is anything else."""
        read = self._read_compact(messages)
        if read is None:
            return None
        sources, indices = np.arange(len(messages)), np.zeros(len(messages), np.int64)
        if read.ids.size > len(messages):
            sources, indices = np.repeat(sources, read.sizes), indices_in(read.sizes)
        numbers = dict(zip(msgpack_columns.NAMES, read.numbers, strict=True))
        batch = batch_of(read.ids, read.leader_ids, numbers, received_us_of(messages)[sources])
        return Decoded(batch, sources, indices, [])

    def _read_compact(self, messages: Sequence[ReceivedMessage]) -> CompactRecords | None:
        """Read valid compact records under known keys; None if a message is anything else."""
        if not messages:
            return None
        keys, payloads, encodings, are_puts, _, _ = zip(*messages, strict=True)
        owners = list(map(self._owners.get, keys))
        if None in owners or not all(are_puts) or set(encodings) != {BSM_MSGPACK}:
            return None
        sizes = np.fromiter(map(len, payloads), np.int64, len(payloads))
        if sizes.max() > self._payload_max_bytes:
            return None
        return msgpack_columns.read(b"".join(payloads), sizes, b"".join(cast(list[bytes], owners)), self._bundle_max)

    def _decode_by_form(self, messages: Sequence[ReceivedMessage]) -> Decoded:
        """Decode the messages of each form at once and put all in order: a slow form costs the others nothing."""
        if not messages:
            return self._decode_any(messages)
        forms: dict[str | None, list[int]] = {}
        for i, message in enumerate(messages):
            forms.setdefault(self._form_of(message), []).append(i)
        parts = []
        for form, places in forms.items():
            of_form = messages if len(forms) == 1 else [messages[i] for i in places]
            decoded = None
            if form in UPER_READERS:
                decoded = self._decode_uper(of_form, form)
            elif form == BSM_MSGPACK and len(forms) > 1:
                decoded = self._decode_compact(of_form)
            decoded = decoded or self._decode_any(of_form)
            parts.append(replace(decoded, sources=np.array(places, np.int64)[decoded.sources]))
        return parts[0] if len(parts) == 1 else joined(parts)

    def _form_of(self, message: ReceivedMessage) -> str | None:
        """Return the encoding of a message of a binary feed, and of one that may be compact; None for any other."""
        may_be_compact = message.encoding == BSM_MSGPACK and message.is_put and message.key in self._owners
        may_be_compact &= len(message.payload) <= self._payload_max_bytes
        return message.encoding if may_be_compact or message.encoding in UPER_READERS else None

    def _decode_uper(self, messages: Sequence[ReceivedMessage], encoding: str) -> Decoded:
        frames, rejections = UperFrames(), list[Rejection]()
        for source, message in enumerate(messages):
            owner = self._owner_of(message, rejections)
            if owner is None:
                continue
            found = self._reader.frames(message.payload, encoding, message.received_us + self._clock_offset_us)
            if isinstance(found, RejectedPayload):
                rejections.append(Rejection(found.reason, message, count=found.size))
            else:
                frames.add(found, source, owner)
        return frames.decode(encoding, messages, rejections)

    def _decode_any(self, messages: Sequence[ReceivedMessage]) -> Decoded:
        opened, rejections = self._open(messages)
        sizes = np.array(opened.sizes, dtype=np.int64)
        sources = np.repeat(np.array(opened.sources, dtype=np.int64), sizes)
        indices = indices_in(sizes)
        ids, leader_ids, numbers, good = self._columns(opened.records)
        owners = list(chain.from_iterable(map(repeat, opened.owners, opened.sizes)))
        if ids != owners:
            good[[not may_send(owner, sender) for owner, sender in zip(owners, ids, strict=True)]] = False
        if not good.all():
            for i in np.flatnonzero(~good):
                reason = _reject_reason(opened.records[i]) or NOT_THE_SENDER
                rejections.append(Rejection(reason, messages[sources[i]], index=int(indices[i])))
        kept = np.flatnonzero(good)
        sources = sources[kept]
        received_us = received_us_of(messages)[sources]
        batch = batch_of(*_kept(kept, ids, leader_ids, numbers), received_us)
        return Decoded(batch, sources, indices[kept], rejections)

    def decode_records(self, records: list[Any], received_us: Sequence[int | None]) -> DecodedRecords:
        """Turn compact records of anybody into a batch, in their order, and name what is wrong with the rest.

        `received_us` says for each when it was received; None: at its event time. Where `payload.record_of` found a
        `RejectReason`, that stands in the place of the record.
        """
        ids, leader_ids, numbers, good = self._columns(records)
        places = np.flatnonzero(good)
        t_us = numbers["t_us"]
        times_us = [received_us[i] if received_us[i] is not None else int(t_us[i]) for i in places.tolist()]
        reasons = [(i, _reject_reason(records[i]) or NOT_THE_SENDER) for i in np.flatnonzero(~good).tolist()]
        kept = _kept(places, ids, leader_ids, numbers)
        return DecodedRecords(batch_of(*kept, np.array(times_us, dtype=np.int64)), places, reasons)

    def _columns(self, records: list[Any]) -> tuple[list[Any], list[Any], dict[str, F64], NDArray[np.bool_]]:
        """Return ids, ids of leaders and numbers (R,) of compact records, and which of them the model accepts."""
        table = _BSM.table(_fitting(records, _BSM))
        ids, good = list(table.cells["id"]), table.good
        good[self._not_ids(ids)] = False
        leader_ids, leader_numbers = self._leaders(table.cells["leader"], ids, good)
        return ids, leader_ids, table.numbers | leader_numbers, good

    def records_in(self, messages: Sequence[ReceivedMessage]) -> int:
        """Return the number of records that `decode` would account for."""
        read = self._read_compact(messages)
        if read is not None:
            return read.ids.size
        uper = [message for message in messages if message.encoding in UPER_READERS]
        opened, rejections = self._open([message for message in messages if message.encoding not in UPER_READERS])
        for message in uper:
            found = self._reader.frames(message.payload, message.encoding, 0)
            opened.sizes.append(found.size if isinstance(found, RejectedPayload) else len(found))
        return sum(opened.sizes) + sum(rejection.count for rejection in rejections)

    def _open(self, messages: Sequence[ReceivedMessage]) -> tuple[_Opened, list[Rejection]]:
        opened, rejections = _Opened([], [], [], []), list[Rejection]()
        for source, message in enumerate(messages):
            owner = self._owner_of(message, rejections)
            if owner is None:
                continue
            records = self._reader.read(message.payload, message.encoding, message.received_us + self._clock_offset_us)
            if type(records) is RejectedPayload:
                rejections.append(Rejection(records.reason, message, count=records.size))
                continue
            opened.records.extend(records)
            opened.sources.append(source)
            opened.sizes.append(len(records))
            opened.owners.append(folded(owner) if message.encoding in _J2735_JSON else owner)
        return opened, rejections

    def _owner_of(self, message: ReceivedMessage, rejections: list[Rejection]) -> str | None:
        """Return the only sender allowed in a message; None, with a rejection, if its envelope is wrong."""
        owner = self._owners.get(message.key)
        if owner is None or not message.is_put or len(message.payload) > self._payload_max_bytes:
            reason = self._envelope_reason(message)
            if reason is not None:
                rejections.append(Rejection(reason, message))
                return None
            owner = self._cache_owner(message.key)
        return owner.rstrip(b"\0").decode()

    def _envelope_reason(self, message: ReceivedMessage) -> RejectReason | None:
        if not message.is_put:
            return RejectReason(Outcome.NOT_A_PUT, "only PUT carries a message")
        if has_wildcard(message.key):
            return RejectReason(Outcome.WILDCARD_KEY, "the key stands for more than one")
        address = self._keys.parse(message.key)
        if address is None or address.channel != "bsm":
            return RejectReason(Outcome.IDENTITY_MISMATCH, "the key names no sender")
        if len(message.payload) > self._payload_max_bytes:
            return RejectReason(
                Outcome.PAYLOAD_TOO_LARGE, f"{len(message.payload)} bytes, {self._payload_max_bytes} at most"
            )
        return None

    def _cache_owner(self, key: str) -> bytes:
        sender = key.rpartition("/")[2]
        if len(self._owners) >= _CACHED_MAX:
            self._owners.clear()
        owner = ANY_SENDER if is_gateway(sender) else sender
        return self._owners.setdefault(key, owner.encode().ljust(ID_BYTES, b"\0"))

    def _not_ids(self, values: list[Any]) -> NDArray[np.intp]:
        """Return the indices of values that are no identifiers."""
        try:
            if self._ids.issuperset(values):
                return np.empty(0, dtype=np.intp)
        except TypeError:
            pass  # unhashable, so no identifier
        return np.array([i for i, value in enumerate(values) if not self._is_id(value)], dtype=np.intp)

    def _is_id(self, value: Any) -> bool:
        if type(value) is not str or not is_id(value):
            return False
        if len(self._ids) >= _CACHED_MAX:
            self._ids.clear()
        self._ids.add(value)
        return True

    def _leaders(
        self, column: Sequence[Any], ids: list[Any], good: NDArray[np.bool_]
    ) -> tuple[list[Any], dict[str, F64]]:
        """Return ids and numbers of the declared leaders, clearing `good` of records with an invalid leader."""
        if column.count(None) == len(column):
            return list(column), {name: np.full(len(column), np.nan) for name in _LEADER.kinds}
        table = _LEADER.table(_fitting([_NOTHING if leader is None else leader for leader in column], _LEADER))
        leader_ids = list(table.cells["id"])
        # Without a declared leader the id of the sender stands in, which has been validated.
        declared = [
            sender if leader is None else leader_id
            for leader, leader_id, sender in zip(column, leader_ids, ids, strict=True)
        ]
        good[self._not_ids(declared)] = False
        good[
            [type(sender) is str and leader_id == sender for leader_id, sender in zip(leader_ids, ids, strict=True)]
        ] = False
        good &= table.good
        return leader_ids, table.numbers


def _kept(
    places: NDArray[np.intp], ids: list[Any], leader_ids: list[Any], numbers: dict[str, F64]
) -> tuple[Ids, Ids, dict[str, F64]]:
    """Return the columns of these records only."""
    if places.size < len(ids):
        ids, leader_ids = [ids[i] for i in places], [leader_ids[i] for i in places]
        numbers = {name: column[places] for name, column in numbers.items()}
    return id_column(ids), id_column(leader_ids), numbers


def _fitting(records: list[Any], layout: Layout) -> list[Any]:
    """Replace each record that does not fit the layout by an empty one."""
    width = len(layout.fields)
    if set(map(type, records)) <= {list} and max(map(len, records), default=0) <= width:
        return records
    return [record if type(record) is list and len(record) <= width else _NOTHING for record in records]


def _reject_reason(record: Any) -> RejectReason | None:
    """Return why the model rejects a record, None if it does not."""
    if isinstance(record, RejectReason):
        return record
    if type(record) is not list:
        return RejectReason(Outcome.MALFORMED, "neither a map nor an array of fields")
    if len(record) > len(_BSM.fields):
        return shape_reason(record[0], "more fields than version 1 has")
    try:
        from_record(record)
    except ValidationError as error:
        reasons = [_reason_of(details) for details in error.errors(include_url=False, include_context=False)]
        return min(reasons, key=lambda reason: _WORST_FIRST.index(reason.outcome))
    except ValueError:
        return shape_reason(record[0], "the leader of a record is an array of at most three fields")
    return None


def _reason_of(error: ErrorDetails) -> RejectReason:
    field, value = error["loc"][:1], error["input"]
    if field == ("v",):
        reason = Outcome.WRONG_VERSION
    elif value is None:
        reason = Outcome.UNAVAILABLE
    elif error["type"] == "float_type" and type(value) is int:
        reason = Outcome.OUT_OF_RANGE  # an integer beyond what a double holds
    else:
        reason = _REASONS.get(error["type"], Outcome.MALFORMED)
    return RejectReason(reason, f"{'.'.join(map(str, error['loc'])) or 'record'}: {error['msg']}")
