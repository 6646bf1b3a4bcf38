"""The interface of the bus and its channels. `zenoh_bus.ZenohBus` implements it; tests have one in memory."""

from collections.abc import Mapping
from enum import Enum, unique
from typing import Protocol

from headway.core.types.outcome import Outcome
from headway.edge.transport.message import ReceivedMessage
from headway_schemas.encodings import (
    EVENT_JSON,
    HANDLING_JSON,
    HEALTH_JSON,
    PAIR_STATE_JSON,
    REJECTED_JSON,
    SENSOR_QUALITY_JSON,
    VEHICLE_STATE,
)


@unique
class Channel(Enum):
    """What the service publishes; the value is the encoding."""

    ALERT = EVENT_JSON
    STATE = PAIR_STATE_JSON
    QUALITY = SENSOR_QUALITY_JSON
    REJECTED = REJECTED_JSON
    HEALTH = HEALTH_JSON
    HANDLING = HANDLING_JSON
    HANDOVER = VEHICLE_STATE


class Query(Protocol):
    """A query that waits for its answer."""

    @property
    def key(self) -> str:
        """Key of the queryable."""
        ...

    @property
    def parameters(self) -> Mapping[str, str]:
        """Parameters of the selector."""
        ...

    @property
    def payload(self) -> bytes:
        """What the query carries; empty for most."""
        ...

    def answer(self, payload: bytes, encoding: str) -> None:
        """Answer once and end the query. Any thread may call this."""
        ...

    def refuse(self, reason: str) -> None:
        """Reply with an error of one line and end the query. Any thread may call this."""
        ...


class Bus(Protocol):
    """No method but `wait` blocks, and none raises, whatever the network does."""

    @property
    def received(self) -> int:
        """Messages received so far; each waits, was drained or was shed."""
        ...

    @property
    def waiting(self) -> int:
        """Messages received that are neither drained nor shed."""
        ...

    @property
    def shed(self) -> int:
        """Messages shed so far because too many waited, or too long."""
        ...

    @property
    def shed_records(self) -> Mapping[Outcome, int]:
        """Records in the shed messages, by reason."""
        ...

    @property
    def dropped(self) -> Mapping[str, int]:
        """Messages to publish that were dropped, by reason."""
        ...

    @property
    def disconnected_subscribers(self) -> int:
        """Peers disconnected because they took no alerts."""
        ...

    @property
    def peers(self) -> int:
        """Peers, routers and clients connected."""
        ...

    @property
    def other_services(self) -> tuple[str, ...]:
        """Instances that judge the same site now."""
        ...

    @property
    def connected(self) -> bool:
        """Whether senders can reach this service."""
        ...

    @property
    def subscribed(self) -> bool:
        """Whether the service receives messages."""
        ...

    def wanted(self, channel: Channel) -> bool:
        """Whether the channel has a subscriber; without one the message need not be built."""
        ...

    def drain(self, limit: int, bytes_limit: int, now_ns: int) -> list[ReceivedMessage]:
        """Receive, then return the oldest messages: at most `limit`, about `bytes_limit` bytes, none stale."""
        ...

    def wait(self, timeout_s: float) -> None:
        """Wait for a message, a query or a change of the connection, for so long at most."""
        ...

    def publish(self, channel: Channel, key: str, payload: bytes) -> None:
        """Queue a message for publication."""
        ...

    def next_query(self) -> Query | None:
        """Return the oldest query, None if there is none."""
        ...

    def handovers(self) -> list[tuple[str, bytes]]:
        """Return the states of vehicles that came since the last call, each with its key."""
        ...

    def unsubscribe(self) -> None:
        """Receive nothing more; messages already received by zenoh are still delivered."""
        ...

    @property
    def delivered(self) -> bool:
        """Whether, after `unsubscribe`, every message was delivered."""
        ...
