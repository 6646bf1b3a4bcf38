"""Messages of Kafka topics, and alerts to one.

A position is committed only for what the gateway has taken over, and after an absence it goes on from there. What the
broker no longer has, and what it never had in order, shows as a gap in the offsets of a partition and is counted.
"""

import time
from collections.abc import Callable, Sequence
from typing import Final

import confluent_kafka
import structlog

from headway.errors import UserError
from headway.gateways.connection import Connection
from headway.gateways.frame_queue import FrameQueue
from headway_schemas.frames import Frame

TOPICS: Final = ("topic.OdeBsmJson",)
_AT_ONCE: Final = 500
_POLL_S: Final = 0.05
_SEND_S: Final = 10.0
_ALERTS_ONLY: Final = 1
"""Level of librdkafka's own log, which writes a line at each attempt to connect."""

_UNREACHABLE: Final = (
    confluent_kafka.KafkaError._ALL_BROKERS_DOWN,  # noqa: SLF001 - so it is named
    confluent_kafka.KafkaError._TRANSPORT,  # noqa: SLF001
)

_log: Final = structlog.get_logger(__name__)


class KafkaConsumer:
    """Consumes topics as one member of a group.

    Parameters
    ----------
    queue
        Takes the messages; the source of a frame is its topic.
    brokers
        `host:port`, several joined by commas.
    group
        Consumer group, whose positions the broker keeps.
    from_start
        Whether a group without a position starts with the oldest message.

    Raises
    ------
    UserError
        An option is no option of librdkafka.
    """

    def __init__(
        self,
        queue: FrameQueue,
        brokers: str,
        group: str,
        topics: Sequence[str] = TOPICS,
        *,
        from_start: bool = False,
        options: dict[str, str] | None = None,
    ) -> None:
        self._queue = queue
        self.connection = Connection()
        self._next_offset: dict[tuple[str, int], int] = {}
        self.lost = 0
        try:
            self._consumer = confluent_kafka.Consumer(
                {
                    "bootstrap.servers": brokers,
                    "group.id": group,
                    "auto.offset.reset": "earliest" if from_start else "latest",
                    "reconnect.backoff.max.ms": 2_000,
                    "log_level": _ALERTS_ONLY,
                    "error_cb": self._on_error,
                    **(options or {}),
                }
            )
            self._consumer.subscribe(list(topics), on_assign=self._on_assign)
        except confluent_kafka.KafkaException as error:
            raise UserError(f"kafka {brokers}: {error}") from None

    @property
    def problem(self) -> str | None:
        """Why nothing can come; None: partitions are assigned and a broker answers."""
        return None if self.connection.is_up else "no broker answers"

    def run(self, stopping: Callable[[], bool]) -> None:
        """Consume until it is stopped."""
        while not stopping():
            messages = self._consumer.consume(_AT_ONCE, _POLL_S)
            frames = [frame for message in messages if (frame := self._frame(message)) is not None]
            if frames:
                self.connection.up()
                self._queue.put(frames)

    def close(self) -> None:
        """Commit the positions and leave the group."""
        self._consumer.close()

    def _frame(self, message: confluent_kafka.Message) -> Frame | None:
        error, value, topic = message.error(), message.value(), message.topic() or ""
        if error is not None:
            _log.warning("kafka", error=error.str())
            return None
        place, offset = (topic, message.partition() or 0), message.offset() or 0
        self.lost += max(0, offset - self._next_offset.get(place, offset))
        self._next_offset[place] = offset + 1
        kind, at_ms = message.timestamp()
        known = kind != confluent_kafka.TIMESTAMP_NOT_AVAILABLE and at_ms > 0
        return Frame(value or b"", at_ms * 1000 if known else time.time_ns() // 1000, topic)

    def _on_assign(self, _consumer: object, partitions: Sequence[object]) -> None:
        if partitions:
            self.connection.up()
            _log.info("partitions assigned", count=len(partitions))

    def _on_error(self, error: confluent_kafka.KafkaError) -> None:
        if error.code() in _UNREACHABLE:
            self.connection.down(error.str())


class KafkaAlerts:
    """Sends alerts to one topic, keyed by the suspect.

    Raises
    ------
    UserError
        An option is no option of librdkafka.
    """

    lost = 0

    def __init__(self, brokers: str, topic: str, options: dict[str, str] | None = None) -> None:
        self._topic = topic
        self.connection = Connection(is_up=True)
        try:
            self._producer = confluent_kafka.Producer(
                {
                    "bootstrap.servers": brokers,
                    "enable.idempotence": True,
                    "linger.ms": 0,
                    "log_level": _ALERTS_ONLY,
                    **(options or {}),
                }
            )
        except confluent_kafka.KafkaException as error:
            raise UserError(f"kafka {brokers}: {error}") from None

    @property
    def problem(self) -> str | None:
        """Why the newest alert was not taken; None: it was."""
        return None if self.connection.is_up else "no broker takes the alerts"

    def run(self, stopping: Callable[[], bool]) -> None:
        """Nothing comes from here."""

    def send(self, frame: Frame) -> bool:
        """Send an alert and wait until the broker has it; False if it is not there."""
        delivered: list[bool] = []
        suspect = frame.source.rpartition("/")[2]
        self._producer.produce(
            self._topic, frame.payload, suspect, on_delivery=lambda error, _: delivered.append(error is None)
        )
        until_s = time.monotonic() + _SEND_S
        while not delivered and time.monotonic() < until_s:
            self._producer.poll(_POLL_S)
        if not delivered:
            self._producer.purge()
            self._producer.poll(_POLL_S)
        if delivered == [True]:
            self.connection.up()
        else:
            self.connection.down("alert not taken")
        return delivered == [True]

    def close(self) -> None:
        """Release the connection."""
        self._producer.flush(1.0)
