"""A real broker, started by the tests, killed and started again under load."""

import json
import shutil
import subprocess
import threading
from collections.abc import Iterator
from pathlib import Path

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
    """One mosquitto on a port of its own, which keeps its sessions over a restart."""

    def __init__(self, folder: Path) -> None:
        self.port = int(free_endpoint().rpartition(":")[2])
        self._file = folder / "mosquitto.conf"
        self._file.write_text(
            f"listener {self.port} 127.0.0.1\nallow_anonymous true\npersistence true\n"
            f"persistence_location {folder}/\nautosave_interval 1\nmax_queued_messages 0\nuser root\n"
        )
        self.start()

    def start(self) -> None:
        assert MOSQUITTO is not None
        self.process = subprocess.Popen([MOSQUITTO, "-c", str(self._file)], stderr=subprocess.DEVNULL)

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()


@pytest.fixture
def broker(tmp_path: Path) -> Iterator[Broker]:
    broker = Broker(tmp_path)
    yield broker
    broker.kill()


class Sender:
    """A vehicle side client; `taken` are the numbers that the broker has acknowledged."""

    def __init__(self, port: int) -> None:
        self.taken: set[int] = set()
        self._numbers: dict[int, int] = {}
        self.client = paho.Client(CallbackAPIVersion.VERSION2, client_id="sender")
        self.client.reconnect_delay_set(1, 1)
        self.client.on_publish = lambda _c, _d, mid, _r, _p: self.taken.add(self._numbers[mid])
        self.client.connect_async("127.0.0.1", port)
        self.client.loop_start()
        until(self.client.is_connected)

    def send(self, number: int) -> None:
        published = self.client.publish(f"5g/outQueue/v2x/cam/{number}/0/1/2/3", json.dumps({"n": number}), 1)
        self._numbers[published.mid] = number

    def close(self) -> None:
        self.client.disconnect()
        self.client.loop_stop()


@needs_broker
def test_topics_are_patterns_and_the_topic_is_the_source(broker: Broker) -> None:
    queue = FrameQueue(1000, 60_000)
    gateway, sender = (
        MqttClient(queue, f"127.0.0.1:{broker.port}", "gw", ["5g/outQueue/v2x/cam/+/#"]),
        Sender(broker.port),
    )
    until(lambda: gateway.problem is None)
    until(lambda: sender.send(7) or len(queue))
    (frame, *_) = queue.take(1, 60_000)
    assert (json.loads(frame.payload), frame.source) == ({"n": 7}, "5g/outQueue/v2x/cam/7/0/1/2/3")
    sender.close()
    gateway.close()


@needs_broker
def test_a_broker_killed_under_load_and_started_again(broker: Broker) -> None:
    """What the broker acknowledged after its restart arrives; the gateway counts the break and goes on."""
    queue = FrameQueue(100_000, 60_000)
    gateway, sender = (
        MqttClient(queue, f"127.0.0.1:{broker.port}", "gw", ["5g/outQueue/v2x/cam/+/#"]),
        Sender(broker.port),
    )
    until(lambda: gateway.problem is None)
    until(lambda: sender.send(0) or len(queue))
    number = 1
    for _ in range(500):
        sender.send(number)
        number += 1
    broker.kill()
    until(lambda: gateway.problem is not None)
    broker.start()
    until(lambda: gateway.problem is None and sender.client.is_connected())
    first_after = number
    for _ in range(500):
        sender.send(number)
        number += 1
    until(lambda: set(range(first_after, number)) <= sender.taken)
    received: set[int] = set()

    def all_there() -> bool:
        received.update(json.loads(frame.payload)["n"] for frame in queue.take(1000, 10**9))
        return set(range(first_after, number)) <= received

    until(all_there)
    assert gateway.disconnections == 1
    sender.close()
    gateway.close()


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


def test_addresses_of_brokers() -> None:
    assert host_port("broker.example", 1883) == ("broker.example", 1883)
    assert host_port("broker.example:8883", 1883) == ("broker.example", 8883)
    for wrong in ("", "a:b"):
        with pytest.raises(UserError, match="--broker"):
            host_port(wrong, 1883)
