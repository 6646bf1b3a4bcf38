"""What the loop needs of a bus, and what may be said on it; `bus.ZenohBus` is one, tests have another in memory."""

from collections.abc import Mapping
from enum import Enum, unique
from typing import Protocol

from headway.core.types.outcome import Outcome
from headway.edge.transport.message import Arrival
from headway_schemas.encodings import EVENT_JSON, HEALTH_JSON, PAIR_STATE_JSON, REJECTED_JSON


@unique
class Channel(Enum):
    """What the service tells; the value is the encoding."""

    ALERT = EVENT_JSON
    STATE = PAIR_STATE_JSON
    REJECTED = REJECTED_JSON
    HEALTH = HEALTH_JSON


class Query(Protocol):
    """A question that waits for its answer."""

    @property
    def key(self) -> str:
        """Key of the queryable that is asked."""
        ...

    @property
    def parameters(self) -> Mapping[str, str]:
        """What narrows the question."""
        ...

    def answer(self, payload: bytes, encoding: str) -> None:
        """Answer, once; the query is over. Any thread may."""
        ...

    def refuse(self, reason: str) -> None:
        """Say in a line why there is no answer; the query is over. Any thread may."""
        ...


class Bus(Protocol):
    """Nothing here blocks or raises, however the network fares."""

    @property
    def received(self) -> int:
        """Messages taken in so far; each is waiting, drained or shed."""
        ...

    @property
    def waiting(self) -> int:
        """Messages taken in and neither drained nor shed."""
        ...

    @property
    def shed(self) -> int:
        """Messages shed so far because too many waited, or for too long."""
        ...

    @property
    def shed_records(self) -> Mapping[Outcome, int]:
        """Records in them, by reason."""
        ...

    @property
    def dropped(self) -> Mapping[str, int]:
        """What was to be told and was not, by reason."""
        ...

    @property
    def transports(self) -> int:
        """Neighbours connected."""
        ...

    @property
    def connected(self) -> bool:
        """Whether senders can reach this service."""
        ...

    @property
    def subscribed(self) -> bool:
        """Whether messages are being taken in."""
        ...

    def wanted(self, channel: Channel) -> bool:
        """Whether anybody listens to the channel; what nobody wants need not be made."""
        ...

    def drain(self, limit: int, bytes_limit: int, now_ns: int) -> list[Arrival]:
        """Take in what has come, and take out the oldest: at most `limit`, about `bytes_limit` bytes, none stale."""
        ...

    def publish(self, channel: Channel, key: str, payload: bytes) -> None:
        """Hand a message over to be told soon."""
        ...

    def next_query(self) -> Query | None:
        """Take the oldest question out."""
        ...

    def unsubscribe(self) -> None:
        """Take nothing more in; what is under way is still delivered."""
        ...

    @property
    def delivered(self) -> bool:
        """Whether, after `unsubscribe`, nothing is under way."""
        ...
