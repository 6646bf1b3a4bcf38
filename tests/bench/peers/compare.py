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
        producer = confluent_kafka.Producer({"bootstrap.servers": cluster.brokers, "linger.ms": 1})

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


PEERS: dict[str, tuple[Start, int]] = {
    "headway": (ours, 6_000),
    "naive: zenoh, pydantic, filterpy": (naive("FilterpyPair"), 1_500),
    "Flink, Java API": (over_a_socket(environments.java_command), 2_000),
    "Flink, PyFlink": (over_a_socket(pyflink), 400),
    "quixstreams": (quixstreams, 400),
}
"""What runs each, and the first guess of how many vehicles it holds."""


def row(start: Start, guess: int) -> str:
    """Return the cells of a peer: the common load, then the most that it holds."""
    try:
        common = measured_load(start, COMMON, 1, SECONDS, WARMUP_S)
        most = most_held(start, guess, 1, within=WITHIN, warmup_s=WARMUP_S)
    except PeerError as error:
        return f"did not run: {error} | | | | |"
    latency, service = common.latency, common.service
    assert latency is not None
    assert service is not None
    assert service.rss_mb is not None
    return (
        f"{10 * most.vehicles:,} | {_cpu(most)} | {latency.p50:.1f} / {latency.p99:.0f}"
        f" | {_cpu(common)} | {service.rss_mb:.0f} |"
    )


def _cpu(outcome: Outcome) -> str:
    assert outcome.service is not None
    assert outcome.service.cpu_us is not None
    return f"{outcome.service.cpu_us:.0f}"


def main(*names: str) -> None:
    """Measure the peers of these names, or all."""
    sys.stdout.write(
        f"load of the machine {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors\n\n"
        f"| | messages a second held | CPU us a message there | p50 / p99 ms at {10 * COMMON:,} a second"
        " | CPU us a message | memory MB |\n| --- | ---: | ---: | ---: | ---: | ---: |\n"
    )
    for name, (start, guess) in PEERS.items():
        if not names or name in names:
            sys.stdout.write(f"| {name} | {row(start, guess)}\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main(*sys.argv[1:])
