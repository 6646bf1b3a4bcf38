"""The mock cluster of librdkafka: real sockets and the real protocol, in a process of its own that can be killed."""

import json
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from gateways.gateway_process import running
from sim.loopback import free_endpoint, session
from sim.until import until

confluent_kafka = pytest.importorskip("confluent_kafka", reason="the extra kafka is not installed")

from headway.errors import UserError  # noqa: E402
from headway.gateways.frame_queue import FrameQueue  # noqa: E402
from headway.gateways.kafka import KafkaAlerts, KafkaConsumer  # noqa: E402
from headway_schemas.encodings import J2735_ODE  # noqa: E402
from headway_schemas.frames import Frame, unpack  # noqa: E402
from headway_schemas.keys import Keys  # noqa: E402

TOPIC = "topic.OdeBsmJson"


class Cluster:
    """A mock cluster of one broker."""

    def __init__(self) -> None:
        command = [sys.executable, str(Path(__file__).parent / "mock_kafka_process.py")]
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        self.brokers = self._answer()

    def say(self, word: str) -> None:
        """Take the broker down, or up again."""
        assert self.process.stdin is not None
        self.process.stdin.write(f"{word}\n")
        self.process.stdin.flush()
        assert self._answer() == "obeyed"

    def close(self) -> None:
        self.process.kill()
        self.process.communicate()

    def _answer(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.readline().strip()


@pytest.fixture
def cluster() -> Iterator[Cluster]:
    cluster = Cluster()
    yield cluster
    cluster.close()


def produce(brokers: str, numbers: range, topic: str = TOPIC) -> None:
    producer = confluent_kafka.Producer({"bootstrap.servers": brokers})
    for number in numbers:
        producer.produce(topic, json.dumps({"n": number}).encode())
    assert producer.flush(20.0) == 0


def numbers_in(queue: FrameQueue) -> list[int]:
    """Return the numbers in the queue, sorted: each partition has an order of its own."""
    return sorted(json.loads(frame.payload)["n"] for frame in queue.take(10_000, 10**9))


@pytest.fixture
def queue() -> FrameQueue:
    return FrameQueue(100_000, 60_000)


class Running:
    """A consumer in a thread."""

    def __init__(self, queue: FrameQueue, brokers: str, group: str = "g") -> None:
        self._stop = threading.Event()
        self.consumer = KafkaConsumer(queue, brokers, group, [TOPIC], from_start=True)
        self._thread = threading.Thread(target=self.consumer.run, args=(self._stop.is_set,), daemon=True)
        self._thread.start()

    def stop(self) -> None:
        self._stop.set()
        self._thread.join()
        self.consumer.close()


def test_messages_come_with_their_topic_and_time(cluster: Cluster, queue: FrameQueue) -> None:
    produce(cluster.brokers, range(1000))
    running = Running(queue, cluster.brokers)
    until(lambda: queue.received == 1000)
    first = queue.take(1, 10**6)[0]
    assert (first.source, first.received_us > 1_600_000_000_000_000) == (TOPIC, True)
    queue.put([first])
    assert numbers_in(queue) == list(range(1000))
    assert running.consumer.problem is None
    running.stop()


def test_the_broker_keeps_the_position_of_the_group(cluster: Cluster, queue: FrameQueue) -> None:
    produce(cluster.brokers, range(100))
    running = Running(queue, cluster.brokers)
    until(lambda: queue.received == 100)
    running.stop()
    reader = confluent_kafka.Consumer({"bootstrap.servers": cluster.brokers, "group.id": "g"})
    partitions = [confluent_kafka.TopicPartition(TOPIC, number) for number in range(4)]
    assert sum(max(0, place.offset) for place in reader.committed(partitions, timeout=10.0)) == 100
    reader.close()


def test_a_broker_that_goes_under_load_and_comes_back(cluster: Cluster, queue: FrameQueue) -> None:
    """Nothing that the broker has acknowledged is lost; what it has not is named by the producer."""
    running = Running(queue, cluster.brokers)
    producer = confluent_kafka.Producer({"bootstrap.servers": cluster.brokers, "reconnect.backoff.max.ms": 500})
    taken, refused = set[int](), set[int]()

    def send(numbers: range) -> None:
        for number in numbers:
            note = lambda error, _, number=number: (refused if error else taken).add(number)  # noqa: E731
            producer.produce(TOPIC, json.dumps({"n": number}).encode(), on_delivery=note)
            producer.poll(0)

    send(range(1000))
    until(lambda: producer.flush(0.1) == 0 and queue.received == 1000)
    cluster.say("down")
    send(range(1000, 2000))
    until(lambda: producer.poll(0.1) is not None and running.consumer.problem is not None)
    cluster.say("up")
    send(range(2000, 3000))
    until(lambda: producer.flush(0.1) == 0, 60.0)
    assert taken | refused == set(range(3000))
    assert taken >= set(range(1000))
    until(lambda: queue.received >= len(taken), 60.0)
    assert set(numbers_in(queue)) >= taken
    assert running.consumer.lost == 0
    until(lambda: running.consumer.problem is None)
    connection = running.consumer.connection
    assert (connection.disconnections, connection.sessions_lost) == (1, 0)
    assert connection.absent_s > 0.0
    running.stop()


class Message:
    """What a consumer yields, at some offset."""

    def __init__(self, offset: int, error: confluent_kafka.KafkaError | None = None) -> None:
        self.offset, self.error = lambda: offset, lambda: error
        self.value, self.topic, self.partition = lambda: b"{}", lambda: TOPIC, lambda: 0
        self.timestamp = lambda: (confluent_kafka.TIMESTAMP_NOT_AVAILABLE, -1)


def test_offsets_that_are_skipped_are_counted_as_lost(cluster: Cluster, queue: FrameQueue) -> None:
    consumer = KafkaConsumer(queue, cluster.brokers, "g", [TOPIC])
    for offset in (5, 6, 10, 11, 11, 12):
        assert consumer._frame(Message(offset)) is not None  # type: ignore[arg-type]
    assert consumer.lost == 3
    error = confluent_kafka.KafkaError(confluent_kafka.KafkaError._TIMED_OUT)
    assert consumer._frame(Message(20, error)) is None  # type: ignore[arg-type]
    assert consumer.lost == 3
    consumer.close()


def test_a_member_that_comes_back_goes_on_where_it_was(cluster: Cluster, queue: FrameQueue) -> None:
    """What came while the group was away is received by the one that joins next, and nothing is skipped."""
    produce(cluster.brokers, range(100))
    first = Running(queue, cluster.brokers)
    until(lambda: queue.received == 100)
    first.stop()
    produce(cluster.brokers, range(100, 200))
    second = Running(queue, cluster.brokers)
    until(lambda: queue.received == 200, 60.0)
    assert numbers_in(queue) == list(range(200))
    assert second.consumer.lost == 0
    second.stop()


def test_alerts_are_keyed_by_their_suspect(cluster: Cluster) -> None:
    alerts = KafkaAlerts(cluster.brokers, "headway.alerts")
    assert alerts.send(Frame(b"{}", 0, "v2x/s/alert/bias/a"))
    reader = confluent_kafka.Consumer(
        {"bootstrap.servers": cluster.brokers, "group.id": "r", "auto.offset.reset": "earliest"}
    )
    reader.subscribe(["headway.alerts"])
    message = None
    while message is None or message.error():
        message = reader.poll(1.0)
    assert (message.key(), message.value()) == (b"a", b"{}")
    reader.close()
    alerts.close()


def test_the_command_goes_both_ways(cluster: Cluster) -> None:
    keys, endpoint = Keys("v2x", "crossing"), free_endpoint()
    messages: list[tuple[str, str, str]] = []
    place = f"--broker {cluster.brokers} --site crossing --connect {endpoint}"
    reader = confluent_kafka.Consumer(
        {"bootstrap.servers": cluster.brokers, "group.id": "r", "auto.offset.reset": "earliest"}
    )
    reader.subscribe(["headway.alerts"])
    with session("peer", listen=(endpoint,)) as bus:
        bus.declare_subscriber(
            keys.every_bsm,
            lambda s: messages.extend(
                (str(s.key_expr), str(s.encoding), frame.source) for frame in unpack(s.payload.to_bytes(), 500)
            ),
        )
        produce(cluster.brokers, range(1))
        with running(f"kafka {place} --topic {TOPIC} --name ode"):
            until(lambda: produce(cluster.brokers, range(1)) or messages, 60.0)
        with running(f"kafka {place} --alerts"):

            def arrived() -> bool:
                bus.put(keys.alert("bias", "a"), b"{}")
                message = reader.poll(0.1)
                return message is not None and not message.error() and message.value() == b"{}"

            until(arrived, 60.0)
    assert messages[0] == (keys.bsm("gw-ode"), J2735_ODE, TOPIC)
    reader.close()


def test_a_wrong_option_is_named(queue: FrameQueue) -> None:
    with pytest.raises(UserError, match="kafka"):
        KafkaConsumer(queue, "b", "g", options={"no.such.option": "1"})
