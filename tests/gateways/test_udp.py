"""Packets on loopback through the receiver, over zenoh, to a subscriber and to the service."""

import random
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from e2e.serving import KEYS, Service, without_headway
from feeds.asn1_modules import encode_bsm, frame_of
from feeds.made_messages import bsm_core
from sim.loopback import free_endpoint, session
from sim.until import until

from headway.errors import UserError
from headway.gateways.bus_port import Forwarder
from headway.gateways.frame_queue import FrameQueue
from headway.gateways.udp import UdpReceiver
from headway_schemas.encodings import J2735_UPER
from headway_schemas.frames import unpack


@pytest.fixture
def queue() -> FrameQueue:
    return FrameQueue(1_000, 60_000)


@pytest.fixture
def receiver(queue: FrameQueue) -> Iterator[UdpReceiver]:
    receiver, stop = UdpReceiver(queue, "127.0.0.1", [0, 0]), threading.Event()
    thread = threading.Thread(target=receiver.run, args=(stop.is_set,))
    thread.start()
    yield receiver
    stop.set()
    thread.join()
    receiver.close()


def send(port: int, *payloads: bytes) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for payload in payloads:
            sender.sendto(payload, ("127.0.0.1", port))


def test_packets_of_every_port_come_with_their_source(queue: FrameQueue, receiver: UdpReceiver) -> None:
    for port in receiver.ports:
        send(port, b"a", b"", bytes(3000))
    until(lambda: queue.received == 6)
    assert {len(frame.payload) for frame in queue.take(10, 60_000)} == {0, 1, 3000}
    assert dict(queue.by_source) == {"127.0.0.1": 6}
    assert receiver.lost == 0


def test_what_a_full_socket_drops_is_counted(queue: FrameQueue) -> None:
    receiver = UdpReceiver(queue, "127.0.0.1", [0])
    packets = 0
    while receiver.lost == 0:  # nobody reads
        send(receiver.ports[0], *[bytes(8000)] * 1000)
        packets += 1000
        assert packets < 100_000
    lost = receiver.lost
    receiver.run(lambda: queue.received + lost >= packets)
    assert queue.received + lost == packets
    receiver.close()


def test_a_port_in_use_is_named(queue: FrameQueue, receiver: UdpReceiver) -> None:
    with pytest.raises(UserError, match="Address already in use"):
        UdpReceiver(queue, "127.0.0.1", receiver.ports[:1])


def test_frames_wait_until_somebody_subscribes(queue: FrameQueue, receiver: UdpReceiver) -> None:
    endpoint, stop, received = free_endpoint(), threading.Event(), []
    with session("peer", listen=(endpoint,)) as bus, session("client", connect=(endpoint,)) as client:
        forwarder = Forwarder(queue, client, KEYS.bsm("gw-udp"), J2735_UPER)
        thread = threading.Thread(target=forwarder.run, args=(stop.is_set,))
        thread.start()
        send(receiver.ports[0], *[bytes([n]) for n in range(200)])
        until(lambda: queue.received == 200)
        assert forwarder.sent == 0
        bus.declare_subscriber(KEYS.every_bsm, lambda s: received.extend(unpack(s.payload.to_bytes(), 500)))
        until(lambda: len(received) == 200)
        assert [frame.payload[0] for frame in received] == list(range(200))
        stop.set()
        thread.join()
    assert forwarder.sent == queue.received == 200
    assert forwarder.bundles < 20


def test_packets_reach_the_service_and_each_is_accounted_for(tmp_path: Path) -> None:
    service = Service(tmp_path)
    port, http = (int(free_endpoint().rpartition(":")[2]) for _ in range(2))
    command = f"gateway udp --host 127.0.0.1 --port {port} --site {KEYS.site} --connect {service.endpoint}"
    gateway = subprocess.Popen(
        [sys.executable, "-m", "headway", *command.split(), "--http-port", str(http)], env=without_headway()
    )
    try:
        until(lambda: is_ready(http))
        core = bsm_core(random.Random(3)) | {
            "secMark": 65_535, "lat": 423_000_001, "long": -837_000_002, "speed": 675
        }  # fmt: skip
        frame = encode_bsm(core)
        text = b"Version=0.7\nType=BSM\nPSID=0x20\nPayload=" + frame.hex().encode()
        send(
            port,
            frame,
            text,
            bytes(range(1, 30)) + frame,
            frame_of(bytes(100), 31),
            b"nothing",
            b"\x03\x80\x28" + frame,
        )
        until(lambda: sum(service.metric("headway_records_total").values()) == 6)
        outcomes = {name: count for name, count in service.metric("headway_records_total").items() if count}
        assert outcomes == {"unavailable": 4, "other_message": 1, "malformed": 1}
        metrics = httpx.get(f"http://127.0.0.1:{http}/metrics").text
        assert 'headway_gateway_received_total{source="127.0.0.1"} 6.0' in metrics
        assert "headway_gateway_sent_total 6.0" in metrics
        gateway.terminate()
        assert gateway.wait(20.0) == 0
    finally:
        gateway.kill()
        gateway.wait()
        service.process.kill()
        service.process.wait()


def is_ready(http: int) -> bool:
    try:
        return httpx.get(f"http://127.0.0.1:{http}/readyz").status_code == 200
    except httpx.TransportError:
        return False
