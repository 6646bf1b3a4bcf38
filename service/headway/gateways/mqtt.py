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
_RETRY_S: Final = (1, 10)
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
    """

    def __init__(
        self, queue: FrameQueue, broker: str, client_id: str, topics: Sequence[str] = (), topic: str = "headway"
    ) -> None:
        self._queue = queue
        self._topics = topics
        self._topic = topic
        self.connection = Connection()
        self._is_known = False
        """Whether the broker has had a session of this client in this run."""
        host, port = host_port(broker, PORT)
        self._client = paho.Client(CallbackAPIVersion.VERSION2, client_id=client_id, clean_session=False)
        self._client.reconnect_delay_set(*_RETRY_S)
        self._client.on_connect = self._on_connect
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
        """Whether the broker is connected."""
        return None if self.connection.is_up else "no connection to the broker"

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
        self.connection.up()
        _log.info("broker connected", topics=list(self._topics))
        if self._topics:
            client.subscribe([(topic, _AT_LEAST_ONCE) for topic in self._topics])

    def _on_disconnect(
        self, _client: paho.Client, _data: object, _flags: object, reason: ReasonCode, _properties: object
    ) -> None:
        self.connection.down(str(reason))

    def _on_message(self, _client: paho.Client, _data: object, message: paho.MQTTMessage) -> None:
        self._queue.put([Frame(bytes(message.payload), time.time_ns() // 1000, message.topic)])


def host_port(address: str, default: int) -> tuple[str, int]:
    """Return the host and the port of `host:port`. Raises `UserError`."""
    host, _, port = address.partition(":")
    if not host or not (port or str(default)).isdecimal():
        raise UserError(f"--broker {address}: write it like broker.example:{default}")
    return host, int(port or default)
