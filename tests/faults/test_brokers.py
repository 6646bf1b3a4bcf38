"""A broker killed and started again under load: what was lost is named by a count or by a span, then all goes on."""

import json
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest
from e2e.serving import KEYS, Service, without_headway
from feeds.made_forms import MESSAGES
from gateways.recordings.made_files import Reading
from prometheus_client.parser import text_string_to_metric_families
from sim.loopback import free_endpoint
from sim.until import until

pytest.importorskip("paho.mqtt.client", reason="the extra mqtt is not installed")
confluent_kafka = pytest.importorskip("confluent_kafka", reason="the extra kafka is not installed")
from gateways.test_kafka import Cluster  # noqa: E402
from gateways.test_mqtt import Broker, Sender, needs_broker  # noqa: E402

CARS, LOADED_S, AWAY_S = 50, 4.0, 3.0
TOPIC = "v2x/cam"
ODE_TOPIC = "topic.OdeBsmJson"


class Load(threading.Thread):
    """Cars that send ten times a second through a broker, until it is stopped."""

    def __init__(self, form: str, put: Callable[[int, bytes], None]) -> None:
        super().__init__(daemon=True)
        self._form, self._put, self._done = MESSAGES[form], put, threading.Event()
        self.sent = 0

    def run(self) -> None:
        step = 0
        start_us, start_s = time.time_ns() // 1000, time.monotonic()
        while not self._done.wait(max(0.0, start_s + 0.1 * step - time.monotonic())):
            for car in range(1, CARS + 1):
                self._put(self.sent, self._form.write(Reading(car, step, start_us)))
                self.sent += 1
            step += 1

    def stop(self) -> None:
        self._done.set()
        self.join()


@contextmanager
def gateway(command: str, service: Service) -> Iterator[Callable[[], dict[str, float]]]:
    """Run a gateway to the service; yields what reads its metrics, without the prefix of their names, and `ready`."""
    http = int(free_endpoint().rpartition(":")[2])
    words = [*command.split(), "--site", KEYS.site, "--connect", service.endpoint, "--http-port", str(http)]
    process = subprocess.Popen([sys.executable, "-m", "headway", "gateway", *words], env=without_headway())

    def read(page: str) -> str:
        try:
            return httpx.get(f"http://127.0.0.1:{http}/{page}").raise_for_status().text
        except httpx.HTTPError:
            return ""

    def metrics() -> dict[str, float]:
        samples = [sample for one in text_string_to_metric_families(read("metrics")) for sample in one.samples]
        found = {sample.name.removeprefix("headway_gateway_"): sample.value for sample in samples}
        return found | {"ready": float(bool(read("readyz")))}

    try:
        until(lambda: read("readyz"), 60.0)
        yield metrics
    finally:
        process.kill()
        process.wait()


@pytest.fixture
def mqtt_broker(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Broker]:
    broker = Broker(tmp_path, request.param)
    yield broker
    broker.kill()


@pytest.fixture
def cluster() -> Iterator[Cluster]:
    cluster = Cluster()
    yield cluster
    cluster.close()


def outcomes(service: Service) -> int:
    """Return how many messages are judged; ask before the load is, whose messages go on meanwhile."""
    return round(sum(service.metric("headway_records_total").values()))


@needs_broker
@pytest.mark.parametrize("mqtt_broker", ["true", "false"], indirect=True)
def test_mqtt_broker(start, measured, mqtt_broker: Broker, request: pytest.FixtureRequest) -> None:
    """Messages that a sender keeps until the broker acknowledges them come late; the others are in the span."""
    broker, service, persistence = mqtt_broker, start(), request.node.callspec.params["mqtt_broker"]
    with gateway(f"mqtt --broker 127.0.0.1:{broker.port} --topic {TOPIC}/#", service) as metrics:
        sender = Sender(broker.port)
        load = Load("CAM JSON, vanetza-nap", lambda n, payload: sender.publish(n, f"{TOPIC}/{n % CARS}", payload))
        load.start()
        time.sleep(LOADED_S)
        broker.kill()
        time.sleep(AWAY_S)
        broker.start()
        until(lambda: metrics().get("disconnections_total") == 1)
        until(lambda: sender.client.is_connected() and metrics()["ready"])
        time.sleep(2.0)
        judged_before, first = outcomes(service), load.sent
        time.sleep(LOADED_S)
        load.stop()
        until(lambda: sender.has_taken(range(first, load.sent)))
        until(lambda: outcomes(service) >= judged_before + load.sent - first)
        found, judged = metrics(), outcomes(service)
    sender.close()
    lost = load.sent - judged
    got = (
        f"{load.sent} sent, {max(lost, 0)} lost, named {found['absent_seconds_total']:.1f} s,"
        f" sessions lost {found['sessions_lost_total']:.0f}"
    )
    measured(f"MQTT broker killed for {AWAY_S:.0f} s, persistence {persistence}", got, "a span, then all")
    assert found["absent_seconds_total"] > 0.5 * AWAY_S
    assert lost <= (found["absent_seconds_total"] + 2.0) * 10 * CARS
    assert found["sessions_lost_total"] == (persistence == "false")


def test_kafka_broker(start, measured, cluster: Cluster) -> None:
    service = start()
    taken, refused = set[int](), set[int]()
    producer = confluent_kafka.Producer({"bootstrap.servers": cluster.brokers, "reconnect.backoff.max.ms": 500})

    def put(number: int, payload: bytes) -> None:
        note = lambda error, _: (refused if error else taken).add(number)  # noqa: E731
        producer.produce(ODE_TOPIC, payload, on_delivery=note)
        producer.poll(0)

    put(-1, json.dumps({}).encode())
    producer.flush(10.0)
    with gateway(f"kafka --broker {cluster.brokers} --topic {ODE_TOPIC}", service) as metrics:
        load = Load("ODE JSON, schema 9", put)
        load.start()
        until(lambda: service.judged() > CARS, 60.0)
        judged_before, first = outcomes(service), load.sent
        time.sleep(LOADED_S)
        cluster.say("down")
        time.sleep(AWAY_S)
        cluster.say("up")
        until(lambda: metrics().get("disconnections_total") == 1)
        time.sleep(LOADED_S)
        load.stop()
        until(lambda: producer.flush(0.1) == 0, 60.0)
        due = len([number for number in taken if number >= first])
        until(lambda: outcomes(service) >= judged_before + due, 60.0)
        found = metrics()
    got = (
        f"{load.sent} sent, {len(refused)} refused to the sender, {found['lost_total']:.0f} lost,"
        f" named {found['absent_seconds_total']:.1f} s"
    )
    measured(f"Kafka broker away for {AWAY_S:.0f} s", got, "a count, then all")
    assert found["lost_total"] == 0
    assert found["absent_seconds_total"] > 0.0
