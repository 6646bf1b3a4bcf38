"""A real broker, started by the tests, killed and started again under load."""

import json
import shutil
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
from gateways.gateway_process import running
from sim.loopback import free_endpoint, session
from sim.until import until

paho = pytest.importorskip("paho.mqtt.client", reason="the extra mqtt is not installed")
from paho.mqtt.enums import CallbackAPIVersion  # noqa: E402

from headway.errors import UserError  # noqa: E402
from headway.gateways.frame_queue import FrameQueue  # noqa: E402
from headway.gateways.mqtt import MqttClient, host_port  # noqa: E402
from headway_schemas.encodings import CAM_JSON  # noqa: E402
from headway_schemas.frames import Frame, unpack  # noqa: E402
from headway_schemas.keys import Keys  # noqa: E402

MOSQUITTO = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin")
needs_broker = pytest.mark.skipif(MOSQUITTO is None, reason="needs mosquitto (Debian: apt-get install mosquitto)")


class Broker:
    """One mosquitto on a port of its own, which may keep its sessions over a restart.

    It writes all that it keeps after each 100 changes: after each one it would take minutes for a backlog.
    """

    def __init__(self, folder: Path, persistence: str = "true") -> None:
        self.port = int(free_endpoint().rpartition(":")[2])
        self._file = folder / "mosquitto.conf"
        self._file.write_text(
            f"listener {self.port} 127.0.0.1\nallow_anonymous true\npersistence {persistence}\n"
            f"persistence_location {folder}/\nautosave_interval 100\nautosave_on_changes true\n"
            "max_queued_messages 0\nuser root\n"
        )
        self.start()

    def start(self) -> None:
        assert MOSQUITTO is not None
        self.process = subprocess.Popen([MOSQUITTO, "-c", str(self._file)], stderr=subprocess.DEVNULL)

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()


@pytest.fixture
def broker(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Broker]:
    """A broker that keeps its sessions; with the parameter `false`, one that keeps none."""
    broker = Broker(tmp_path, getattr(request, "param", "true"))
    yield broker
    broker.kill()


class Sender:
    """A vehicle side client that numbers its messages.

    The acknowledgement of a message may come before its sender knows the id. So both are noted, and compared later.
    """

    def __init__(self, port: int) -> None:
        self._ids: dict[int, int] = {}
        self._acknowledged: set[int] = set()
        self.client = paho.Client(CallbackAPIVersion.VERSION2, client_id="sender")
        self.client.reconnect_delay_set(1, 1)
        self.client.on_publish = lambda _c, _d, mid, _r, _p: self._acknowledged.add(mid)
        self.client.connect_async("127.0.0.1", port)
        self.client.loop_start()
        until(self.client.is_connected)

    def send(self, number: int) -> None:
        self.publish(number, f"5g/outQueue/v2x/cam/{number}/0/1/2/3", json.dumps({"n": number}).encode())

    def publish(self, number: int, topic: str, payload: bytes) -> None:
        self._ids[number] = self.client.publish(topic, payload, 1).mid

    def has_taken(self, numbers: range) -> bool:
        """Whether the broker has acknowledged all of these."""
        return all(self._ids[number] in self._acknowledged for number in numbers)

    def close(self) -> None:
        self.client.disconnect()
        self.client.loop_stop()


class Linked(NamedTuple):
    """A gateway that a message of the sender has reached."""

    queue: FrameQueue
    gateway: MqttClient
    sender: Sender

    def send(self, numbers: range) -> None:
        for number in numbers:
            self.sender.send(number)

    def receive(self, numbers: range) -> set[int]:
        """Wait until these have come; return all that have."""
        received: set[int] = set()

        def are_there() -> bool:
            received.update(json.loads(frame.payload)["n"] for frame in self.queue.take(1000, 10**9))
            return set(numbers) <= received

        until(are_there)
        return received


@pytest.fixture
def linked(broker: Broker) -> Iterator[Linked]:
    queue = FrameQueue(100_000, 60_000)
    gateway = MqttClient(queue, f"127.0.0.1:{broker.port}", "gw", ["5g/outQueue/v2x/cam/+/#"])
    sender = Sender(broker.port)
    until(lambda: gateway.problem is None)
    until(lambda: sender.send(0) or len(queue))
    yield Linked(queue, gateway, sender)
    sender.close()
    gateway.close()


@needs_broker
def test_topics_are_patterns_and_the_topic_is_the_source(linked: Linked) -> None:
    (frame, *_) = linked.queue.take(1, 60_000)
    assert (json.loads(frame.payload), frame.source) == ({"n": 0}, "5g/outQueue/v2x/cam/0/0/1/2/3")


@needs_broker
@pytest.mark.parametrize(("broker", "sessions_lost"), [("true", 0), ("false", 1)], indirect=["broker"])
def test_a_broker_killed_under_load_and_started_again(broker: Broker, linked: Linked, sessions_lost: int) -> None:
    """What the broker acknowledged after its restart arrives; the break, its length and what it cost are named."""
    connection = linked.gateway.connection
    linked.send(range(1, 501))
    until(lambda: linked.sender.has_taken(range(1, 251)))
    killed_s = time.monotonic()
    broker.kill()
    until(lambda: linked.gateway.problem is not None)
    lost_s = time.monotonic()
    broker.start()
    until(lambda: linked.gateway.problem is None)
    back_s = time.monotonic()
    until(linked.sender.client.is_connected)
    after = range(501, 1001)
    linked.send(after)
    until(lambda: linked.sender.has_taken(after))
    linked.receive(after)
    assert (connection.disconnections, connection.sessions_lost) == (1, sessions_lost)
    assert 0.0 < connection.absent_s <= back_s - killed_s
    assert connection.absent_s >= back_s - lost_s - 0.5


@needs_broker
def test_alerts_wait_for_a_broker_and_go_below_a_topic(broker: Broker) -> None:
    gateway = MqttClient(FrameQueue(10, 1000), f"127.0.0.1:{broker.port}", "gw", topic="headway")
    until(lambda: gateway.problem is None)
    received: list[tuple[str, bytes]] = []
    reader, subscribed = paho.Client(CallbackAPIVersion.VERSION2), threading.Event()
    reader.on_subscribe = lambda *_: subscribed.set()
    reader.on_message = lambda _c, _d, message: received.append((message.topic, message.payload))
    reader.connect("127.0.0.1", broker.port)
    reader.subscribe("headway/#", 1)
    reader.loop_start()
    assert subscribed.wait(10.0)
    alert = Frame(b"{}", 0, "v2x/crossing/alert/bias/a")
    until(lambda: gateway.send(alert))
    until(lambda: received)
    assert received[0] == ("headway/crossing/alert/bias/a", b"{}")
    broker.kill()
    until(lambda: not gateway.send(alert))
    reader.loop_stop()
    gateway.close()


@needs_broker
def test_the_command_goes_both_ways(broker: Broker) -> None:
    """Messages of the broker reach a subscriber of the bus, alerts of the bus a subscriber of the broker."""
    keys, endpoint = Keys("v2x", "crossing"), free_endpoint()
    messages: list[tuple[str, str, bytes]] = []
    alerts: list[tuple[str, bytes]] = []
    sender = Sender(broker.port)
    sender.client.on_message = lambda _c, _d, message: alerts.append((message.topic, message.payload))
    sender.client.subscribe("headway/#", 1)
    place = f"--broker 127.0.0.1:{broker.port} --site crossing --connect {endpoint}"
    with session("peer", listen=(endpoint,)) as bus:
        bus.declare_subscriber(
            keys.every_bsm,
            lambda s: messages.extend(
                (str(s.key_expr), str(s.encoding), frame.payload) for frame in unpack(s.payload.to_bytes(), 500)
            ),
        )
        with running(f"mqtt {place} --topic 5g/outQueue/v2x/cam/+/# --name mec"):
            until(lambda: sender.send(5) or messages)
        with running(f"mqtt {place} --alerts"):
            until(lambda: bus.put(keys.alert("bias", "a"), b"{}") or alerts)
    assert messages[0] == (keys.bsm("gw-mec"), CAM_JSON, b'{"n": 5}')
    assert alerts[0] == ("headway/crossing/alert/bias/a", b"{}")
    sender.close()


class Refusing(NamedTuple):
    """The reason of a subscription that is refused, or is not."""

    is_failure: bool


def test_a_topic_that_the_broker_refuses_is_a_problem_by_name() -> None:
    gateway = MqttClient(FrameQueue(10, 1000), f"127.0.0.1:{free_endpoint().rpartition(':')[2]}", "gw", ["a/#", "b"])
    assert gateway.problem == "no connection to the broker"
    gateway._on_subscribe(gateway._client, None, 1, [Refusing(False), Refusing(True)], None)
    assert gateway.problem == "the broker refuses b"
    gateway._on_subscribe(gateway._client, None, 2, [Refusing(False), Refusing(False)], None)
    assert gateway.problem is None
    gateway.close()


def test_a_topic_that_is_not_utf_8_stops_nothing() -> None:
    queue = FrameQueue(10, 1000)
    gateway = MqttClient(queue, f"127.0.0.1:{free_endpoint().rpartition(':')[2]}", "gw", ["#"])
    message = paho.MQTTMessage(topic=b"v2x/\xff")
    message.payload = b"{}"
    gateway._on_message(gateway._client, None, message)
    assert [(frame.payload, frame.source) for frame in queue.take(1, 1000)] == [(b"{}", "not UTF-8")]
    gateway.close()


@pytest.mark.parametrize("pattern", ["", "a/#/b", "a/b#", "a+/b"])
def test_a_topic_that_is_no_pattern_is_refused_at_once(pattern: str) -> None:
    with pytest.raises(UserError, match="--topic"):
        MqttClient(FrameQueue(10, 1000), "127.0.0.1", "gw", [pattern])


def test_addresses_of_brokers() -> None:
    assert host_port("broker.example", 1883) == ("broker.example", 1883)
    assert host_port("broker.example:8883", 1883) == ("broker.example", 8883)
    for wrong in ("", "a:b"):
        with pytest.raises(UserError, match="--broker"):
            host_port(wrong, 1883)
