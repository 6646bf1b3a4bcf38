"""The same job in headway, a naive service, Flink and quixstreams, under the same load: prints one table.

The job is to parse a message, to find its vehicle, to update the vehicle's filter and to compare with a gate. The
generator and the judge are those of the load test. A peer that cannot run here has the reason in its row.
"""

import json
import os
import socket
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from typing import NamedTuple

import confluent_kafka
import msgpack
import zenoh
from bench.peers import environments
from bench.peers.bridge import READY_S, Bridge, PeerError
from bench.services import Running, Start, measured_load, most_held, naive, ours
from gateways.test_kafka import Cluster

from headway_loadtest.measure.result import Outcome

TOPIC = "bsm"
COMMON, SECONDS, WARMUP_S, WITHIN = 200, 10.0, 8.0, 1.25
ROUNDS = 3
HELLO = [1, "hello", 0, 0, 0.0, 0.0, 0.0]
HERE = Path(__file__).parent


def line_of(record: list[object]) -> bytes:
    """Return a record as peers read it."""
    return json.dumps(record, separators=(",", ":")).encode()


def wait(bridge: Bridge, put: Callable[[], None]) -> None:
    """Send a message until the peer judges it, then the next: the peer is ready."""
    deadline_s = time.monotonic() + READY_S
    while True:
        put()
        if bridge.wait(1):
            return
        if time.monotonic() > deadline_s:
            raise PeerError(f"judged nothing within {READY_S:.0f} s")


def over_a_socket(command: Callable[[], list[str]]) -> Start:
    """Return what runs a peer that reads lines from a socket."""

    @contextmanager
    def start(_vehicles: int) -> Iterator[Running]:
        with socket.create_server(("127.0.0.1", 0)) as server, tempfile.TemporaryDirectory() as folder:
            server.settimeout(READY_S)
            with Bridge([*command(), str(server.getsockname()[1])], Path(folder)) as bridge:
                connection, _ = _accepted(server, bridge)
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

                def put(_key: zenoh.KeyExpr, payload: bytes) -> None:
                    connection.sendall(line_of(msgpack.unpackb(payload)) + b"\n")

                with connection:
                    wait(bridge, lambda: connection.sendall(line_of(HELLO) + b"\n"))
                    yield Running(bridge.endpoint, put)

    return start


def _accepted(server: socket.socket, bridge: Bridge) -> tuple[socket.socket, object]:
    server.settimeout(1.0)
    deadline_s = time.monotonic() + READY_S
    while time.monotonic() < deadline_s:
        try:
            return server.accept()
        except TimeoutError:
            bridge.wait(0)
    raise PeerError(f"connected not within {READY_S:.0f} s")


@contextmanager
def quixstreams(_vehicles: int) -> Iterator[Running]:
    """Run quixstreams on the mock cluster of librdkafka."""
    cluster = Cluster()
    try:
        producer = confluent_kafka.Producer({"bootstrap.servers": cluster.brokers, "linger.ms": 1, "log_level": 1})

        def produce(record: list[object]) -> None:
            while True:
                try:
                    producer.produce(TOPIC, line_of(record), str(record[1]))
                    producer.poll(0)
                except BufferError:
                    producer.poll(0.01)
                else:
                    return

        produce(HELLO)
        producer.flush(10.0)
        with tempfile.TemporaryDirectory() as folder:
            command = [environments.python_of(environments.QUIX), str(HERE / "quix_job.py"), cluster.brokers, TOPIC]
            with Bridge([*command, f"{folder}/state"], Path(folder)) as bridge:
                wait(bridge, lambda: None)
                yield Running(bridge.endpoint, lambda _key, payload: produce(msgpack.unpackb(payload)))
    finally:
        cluster.close()


def pyflink() -> list[str]:
    """Return the command of the Flink job in Python."""
    environments.flink_library()
    return [environments.python_of(environments.FLINK), str(HERE / "flink_job.py")]


class Peer(NamedTuple):
    """What runs it, the first guess of how many vehicles it holds, and the records of a payload."""

    start: Start
    guess: int
    bundle: int = 1


PEERS: dict[str, Peer] = {
    "headway": Peer(ours, 2_000),
    "headway, bundles of 25": Peer(ours, 8_000, 25),
    "naive: zenoh, pydantic, filterpy": Peer(naive("FilterpyPair"), 500),
    "Flink, Java API": Peer(over_a_socket(environments.java_command), 1_500),
    "Flink, PyFlink": Peer(over_a_socket(pyflink), 300),
    "quixstreams": Peer(quixstreams, 300),
}


class Common(NamedTuple):
    """Of one run at the common load."""

    p50_ms: float
    p99_ms: float
    cpu_us: float
    rss_mb: float


def common(peer: Peer) -> Common:
    """Measure a peer once at the common load."""
    outcome = measured_load(peer.start, COMMON, peer.bundle, SECONDS, WARMUP_S)
    latency, service = outcome.latency, outcome.service
    assert latency is not None
    assert service is not None
    assert service.rss_mb is not None
    return Common(latency.p50, latency.p99, cpu_us(outcome), service.rss_mb)


def cpu_us(outcome: Outcome) -> float:
    """Return the processor time of a message."""
    assert outcome.service is not None
    assert outcome.service.cpu_us is not None
    return outcome.service.cpu_us


def measure(peers: dict[str, Peer]) -> Iterator[str]:
    """Measure peers in turn, then the most that each holds; yield their rows."""
    found: dict[str, list[Common]] = {name: [] for name in peers}
    problems: dict[str, str] = {}
    for _ in range(ROUNDS):
        for name, peer in peers.items():
            try:
                found[name].append(common(peer))
            except PeerError as error:
                problems[name] = str(error)
    for name, peer in peers.items():
        if name in problems:
            yield f"| {name} | did not run: {problems[name]} | | | | |"
            continue
        most = most_held(peer.start, peer.guess, peer.bundle, within=WITHIN, warmup_s=WARMUP_S)
        p50_ms, p99_ms, us, rss_mb = map(median, zip(*found[name], strict=True))
        held = f"{10 * most.vehicles:,} | {cpu_us(most):.0f}"
        yield f"| {name} | {held} | {p50_ms:.1f} / {p99_ms:.1f} | {us:.0f} | {rss_mb:.0f} |"


def main(*names: str) -> None:
    """Print the rows of the peers of these names, or of all."""
    sys.stdout.write(
        f"load of the machine {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors\n\n"
        f"| | messages a second held | CPU us a message there | p50 / p99 ms at {10 * COMMON:,} a second"
        " | CPU us a message | memory MB |\n| --- | ---: | ---: | ---: | ---: | ---: |\n"
    )
    for row in measure({name: peer for name, peer in PEERS.items() if name in names or not names}):
        sys.stdout.write(f"{row}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main(*sys.argv[1:])
