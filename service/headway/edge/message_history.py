"""Original messages of the last seconds, for the evidence of events.

The loop adds references to what it has received: no payload is copied. Only an event
searches for the messages of its suspect and takes them out of their bundles.
"""

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from operator import itemgetter
from secrets import token_bytes
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from headway.core.types.batch import I64, Ids
from headway.core.types.identifiers import ID_WORDS, id_column, id_words
from headway.edge.codec.decoded import Decoded, received_us_of
from headway.edge.codec.originals import original_of
from headway.edge.transport.message import ReceivedMessage
from headway_schemas.event import OriginalMessage

MESSAGES_MAX: Final = 32
"""Most messages of one event."""
AGE_NS: Final = 10_000_000_000
_SPAN_NS: Final = 250_000_000
_OBJECT_BYTES: Final = 140
"""Memory of a payload and its places in lists, besides its octets."""
_RECORD_BYTES: Final = 24
"""Of `_Records`."""
_TOGETHER: Final = 256
"""Records that are stored at once."""
_PAYLOAD: Final = itemgetter(ReceivedMessage._fields.index("payload"))
_SECRETS: Final = np.frombuffer(token_bytes(8 * ID_WORDS), np.uint64) | np.uint64(1)
_ENCODING: Final = itemgetter(ReceivedMessage._fields.index("encoding"))


class _Records(NamedTuple):
    """R decoded records; small, because there are many."""

    senders: NDArray[np.uint64]
    """A hash of each one's identifier."""
    t_us: I64
    places: NDArray[np.uint32]
    """Of their payload within the span."""
    indices: NDArray[np.uint32]
    """Of the record in that payload."""


class _Taken(NamedTuple):
    """What one iteration of the loop received."""

    messages: Sequence[ReceivedMessage]
    decoded: Decoded
    clock_offset_us: int


@dataclass(slots=True)
class _Span:
    """What came within a quarter of a second."""

    since_ns: int
    payloads: list[bytes] = field(default_factory=list)
    encodings: list[str] = field(default_factory=list)
    received_us: list[int] = field(default_factory=list)
    """In Unix time."""
    parts: list[_Records] = field(default_factory=list)
    size: int = 0
    """Bytes of memory."""
    taken: list[_Taken] = field(default_factory=list)
    """Not in the lists above yet: many small iterations together cost less than each by itself."""
    taken_records: int = 0

    def add(self, taken: _Taken) -> int:
        """Take references; return how many bytes they hold in memory."""
        messages, records = taken.messages, len(taken.decoded.batch)
        self.taken.append(taken)
        self.taken_records += records
        if self.taken_records >= _TOGETHER:
            self.store()
        size = sum(map(len, map(_PAYLOAD, messages))) + _OBJECT_BYTES * len(messages) + _RECORD_BYTES * records
        self.size += size
        return size

    def store(self) -> None:
        """Store what was taken, without the columns that nothing needs any more."""
        if not self.taken:
            return
        places = []
        for messages, decoded, clock_offset_us in self.taken:
            places.append(decoded.sources + len(self.payloads))
            self.payloads += map(_PAYLOAD, messages)
            self.encodings += map(_ENCODING, messages)
            self.received_us += (received_us_of(messages) + clock_offset_us).tolist()
        batches = [taken.decoded.batch for taken in self.taken]
        part = _Records(
            _hashes(np.concatenate([batch.ids for batch in batches])),
            np.concatenate([batch.t_us for batch in batches]),
            np.concatenate(places).astype(np.uint32),
            np.concatenate([taken.decoded.indices for taken in self.taken]).astype(np.uint32),
        )
        self.parts.append(part)
        self.taken.clear()
        self.taken_records = 0

    def newest_first(self, sender: np.uint64, until_us: int) -> Iterator[OriginalMessage]:
        """Yield the messages of the sender with this hash up to an event time."""
        self.store()
        if len(self.parts) > 1:
            self.parts = [_Records(*map(np.concatenate, zip(*self.parts, strict=True)))]
        (records,) = self.parts
        rows = np.flatnonzero((records.senders == sender) & (records.t_us <= until_us))
        for row in rows[::-1].tolist():
            place, index = int(records.places[row]), int(records.indices[row])
            yield original_of(self.payloads[place], self.encodings[place], index, self.received_us[place])


def _hashes(ids: Ids) -> NDArray[np.uint64]:
    """Return (R,) a hash of each identifier: words times secret numbers, so that no sender can choose an equal one."""
    hashes: NDArray[np.uint64] = id_words(np.ascontiguousarray(ids)) @ _SECRETS
    return hashes


class MessageHistory:
    """Keeps messages for ten seconds at most.

    Parameters
    ----------
    bytes_limit
        Memory for all messages; beyond it the oldest quarter of a second is dropped.
    event_bytes_limit
        Octets of messages for one event.
    """

    def __init__(self, bytes_limit: int, event_bytes_limit: int) -> None:
        self._bytes_limit = bytes_limit
        self._event_bytes_limit = event_bytes_limit
        self._spans: deque[_Span] = deque()
        self.size = 0
        """Bytes of memory."""

    def add(self, messages: Sequence[ReceivedMessage], decoded: Decoded, clock_offset_us: int) -> None:
        """Keep the messages of a batch; `clock_offset_us` takes their time of reception to Unix time."""
        if not (self._bytes_limit and messages and len(decoded.batch)):
            return
        now_ns = messages[-1].received_ns
        if not self._spans or now_ns - self._spans[-1].since_ns > _SPAN_NS:
            if self._spans:
                self._spans[-1].store()
            self._spans.append(_Span(now_ns))
        self.size += self._spans[-1].add(_Taken(messages, decoded, clock_offset_us))
        while self._spans and (self.size > self._bytes_limit or now_ns - self._spans[0].since_ns > AGE_NS):
            self.size -= self._spans.popleft().size

    def of(self, vehicle: str, until_us: int) -> tuple[OriginalMessage, ...]:
        """Return the newest messages of a vehicle up to an event time, oldest first, as far as they are kept."""
        found: list[OriginalMessage] = []
        size, sender = 0, _hashes(id_column([vehicle]))[0]
        for span in reversed(self._spans):
            for message in span.newest_first(sender, until_us):
                size += len(message.payload)
                if size > self._event_bytes_limit or len(found) == MESSAGES_MAX:
                    return tuple(found[::-1])
                found.append(message)
        return tuple(found[::-1])
