"""Messages of an MQTT broker, and alerts to one.

The session is kept by the broker (a client id of its own, no clean start, quality of service 1). So a broker that
keeps messages delivers those of an absence after it.
"""

import time
from collections.abc import Callable, Sequence
from typing import Final

import paho.mqtt.client as paho
import structlog
from paho.mqtt.enums import CallbackAPIVersion
from paho.mqtt.reasoncodes import ReasonCode

from headway.errors import UserError
from headway.gateways.connection import Connection
from headway.gateways.frame_queue import FrameQueue
from headway_schemas.frames import Frame

PORT: Final = 1883
_AT_LEAST_ONCE: Final = 1
_RETRY_S: Final = (1, 2)
"""Pause between attempts to connect; a broker without sessions loses what comes in it."""
_POLL_S: Final = 0.2
_PUBLISH_S: Final = 5.0

_log: Final = structlog.get_logger(__name__)


class MqttClient:
    """A connection to one broker, which it makes again by itself.

    Parameters
    ----------
    queue
        Takes what comes on `topics`, patterns of MQTT; empty to send only.
    broker
        Host, or host:port.
    client_id
        Name of the session at the broker.
    topic
        Below it alerts are published, by the chunks of their key behind the prefix.

    Raises
    ------
    UserError
        The address is none, or a topic is no pattern.
    """

    def __init__(
        self, queue: FrameQueue, broker: str, client_id: str, topics: Sequence[str] = (), topic: str = "headway"
    ) -> None:
        self._queue = queue
        self._topics = topics
        self._topic = topic
        self.connection = Connection()
        self._refused = list[str]()
        self._is_known = False
        """Whether the broker has had a session of this client in this run."""
        host, port = host_port(broker, PORT)
        for pattern in topics:
            if not _is_pattern(pattern):
                raise UserError(f"--topic {pattern}: + is a whole level, # the last ones, as in v2x/+/cam/#")
        self._client = paho.Client(CallbackAPIVersion.VERSION2, client_id=client_id, clean_session=False)
        self._client.reconnect_delay_set(*_RETRY_S)
        self._client.on_connect = self._on_connect
        self._client.on_subscribe = self._on_subscribe
        self._client.on_disconnect = self._on_disconnect
        self._client.on_message = self._on_message
        self._client.connect_async(host, port)
        self._client.loop_start()

    @property
    def lost(self) -> int:
        """0: a broker does not tell how many messages it dropped; see `Connection.sessions_lost`."""
        return 0

    @property
    def problem(self) -> str | None:
        """Why messages cannot come; None: the broker is connected and has taken the subscriptions."""
        if not self.connection.is_up:
            return "no connection to the broker"
        return f"the broker refuses {', '.join(self._refused)}" if self._refused else None

    def run(self, stopping: Callable[[], bool]) -> None:
        """Receive until it is stopped."""
        while not stopping():
            time.sleep(_POLL_S)

    def send(self, frame: Frame) -> bool:
        """Publish an alert and wait until the broker has it; False if it is not there."""
        if not self.connection.is_up:
            return False
        place = frame.source.partition("/")[2]
        published = self._client.publish(f"{self._topic}/{place}", frame.payload, _AT_LEAST_ONCE)
        try:
            published.wait_for_publish(_PUBLISH_S)
        except (RuntimeError, ValueError):
            return False
        return published.is_published()

    def close(self) -> None:
        """Leave the broker."""
        self._client.disconnect()
        self._client.loop_stop()

    def _on_connect(
        self, client: paho.Client, _data: object, flags: paho.ConnectFlags, reason: ReasonCode, _properties: object
    ) -> None:
        if reason.is_failure:
            _log.warning("broker refuses", reason=str(reason))
            return
        if self._is_known and self._topics and not flags.session_present:
            self.connection.session_lost()
        self._is_known = True
        _log.info("broker connected", topics=list(self._topics))
        if self._topics:
            client.subscribe([(topic, _AT_LEAST_ONCE) for topic in self._topics])
        else:
            self.connection.up()

    def _on_subscribe(
        self, _client: paho.Client, _data: object, _id: int, reasons: list[ReasonCode], _properties: object
    ) -> None:
        self._refused = [topic for topic, reason in zip(self._topics, reasons, strict=False) if reason.is_failure]
        if self._refused:
            _log.warning("broker refuses topics", topics=self._refused)
        self.connection.up()

    def _on_disconnect(
        self, _client: paho.Client, _data: object, _flags: object, reason: ReasonCode, _properties: object
    ) -> None:
        self.connection.down(str(reason))

    def _on_message(self, _client: paho.Client, _data: object, message: paho.MQTTMessage) -> None:
        try:
            topic = message.topic
        except UnicodeDecodeError:
            topic = "not UTF-8"
        self._queue.put([Frame(bytes(message.payload), time.time_ns() // 1000, topic)])


def _is_pattern(topic: str) -> bool:
    levels = topic.split("/")
    whole = all(level in {"+", "#"} or not {"+", "#"} & set(level) for level in levels)
    return bool(topic) and whole and "#" not in levels[:-1]


def host_port(address: str, default: int) -> tuple[str, int]:
    """Return the host and the port of `host:port`. Raises `UserError`."""
    host, _, port = address.partition(":")
    if not host or not (port or str(default)).isdecimal():
        raise UserError(f"--broker {address}: write it like broker.example:{default}")
    return host, int(port or default)
