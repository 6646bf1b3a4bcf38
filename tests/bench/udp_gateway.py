"""Packets of UPER through `headway gateway udp` and the service on loopback, beside direct bundles of the same records.

`python tests/bench/udp_gateway.py --vehicles 2000 --seconds 20` prints a line of JSON for each way: what was sent, what
became of it, and the latency from the event time to the verdict, after the first seconds.
"""

import argparse
import json
import re
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable
from typing import Any, Final

import msgpack
import zenoh

from headway.cli.run.service_process import running_service
from headway_loadtest.traffic.session import connect
from headway_schemas.encodings import BSM_MSGPACK
from headway_schemas.keys import Keys

sys.path.insert(0, "tests")
from feeds.asn1_modules import encode_bsm

RATE_HZ, WARM_S, SITE, SPEED_MPS = 10, 5, "s", 20.0
BLOCK: Final = zenoh.CongestionControl.BLOCK
CPU: Final = "process_cpu_seconds_total"
LAT, LON, LON_PER_M = 42.3, -83.7, 1 / 82_377.0
CORE: Final[dict[str, Any]] = {
    "msgCnt": 0, "id": bytes(4), "secMark": 0, "lat": -900_000_000, "long": -1_799_999_999, "elev": 2600,
    "accuracy": {"semiMajor": 20, "semiMinor": 20, "orientation": 0}, "transmission": "forward", "speed": 1000,
    "heading": 7200, "angle": 0, "accelSet": {"long": 0, "lat": 0, "vert": 0, "yaw": 0},
    "brakes": {"wheels": (b"\0", 5), "traction": "off", "abs": "off", "scs": "off", "boost": "off", "aux": "off"},
    "size": {"width": 190, "length": 460},
}  # fmt: skip
TEMPLATE: Final = encode_bsm(CORE)
_BITS: Final = 8 * len(TEMPLATE) - 24


def packet(vehicle: int, count: int, at_s: float, lat: float, lon: float) -> bytes:
    """Return a BSM: the template with other bits, which costs the generator little."""
    value = int.from_bytes(TEMPLATE, "big")
    for number, bit, width in (
        (count % 128, 3, 7), (vehicle, 10, 32), (int(at_s * 1000) % 60_000, 42, 16),
        (round(lat * 1e7) + 900_000_000, 58, 31), (round(lon * 1e7) + 1_799_999_999, 89, 32),
    ):  # fmt: skip
        value |= number << (_BITS - bit - width)
    return value.to_bytes(len(TEMPLATE), "big")


Send = Callable[[int, int, float, float, float], None]


def drive(vehicles: int, start_s: float, seconds: range, send: Send) -> int:
    """Send each message of these seconds when it is due; return how many. Vehicles are 50 m apart on parallel roads."""
    rate_hz = vehicles * RATE_HZ
    sent, total = seconds.start * rate_hz, seconds.stop * rate_hz
    while sent < total:
        due = min(total, int((time.time() - start_s) * rate_hz))
        for j in range(sent, due):
            vehicle, at_s = j % vehicles, start_s + j / rate_hz
            east_m = 50.0 * (vehicle % 50) + SPEED_MPS * (at_s - start_s)
            send(vehicle, j // vehicles, at_s, LAT + 0.002 * (vehicle // 50), LON + east_m * LON_PER_M)
        sent = max(sent, due)
        time.sleep(0.0005)
    return len(seconds) * rate_hz


def scrape(url: str) -> dict[str, float]:
    """Return the metrics by name and labels."""
    with urllib.request.urlopen(url, timeout=5.0) as answer:
        return {m[1]: float(m[2]) for m in re.finditer(r"^([^# ]\S*) (\S+)$", answer.read().decode(), re.MULTILINE)}


def percentile_ms(before: dict[str, float], after: dict[str, float], share: float) -> float:
    """Return a percentile of the latency between two scrapes, linear within a bucket."""
    edges = [0.0]
    counts = [0.0]
    for name, value in after.items():
        if found := re.fullmatch(r'headway_stage_latency_seconds_bucket\{le="([\d.e+-]+)",stage="intended"\}', name):
            edges.append(float(found[1]))
            counts.append(value - before.get(name, 0.0))
    wanted = share * counts[-1]
    i = next(i for i, count in enumerate(counts) if count >= wanted and i)
    within = (wanted - counts[i - 1]) / max(counts[i] - counts[i - 1], 1.0)
    return round(1e3 * (edges[i - 1] + within * (edges[i] - edges[i - 1])), 2)


def through_gateway(endpoint: str) -> tuple[Send, Callable[[], dict[str, Any]]]:
    """Start the gateway; return what sends a packet to it, and what ends it and tells its account."""
    ports = [probe.getsockname()[1] for probe in (socket.create_server(("127.0.0.1", 0)) for _ in range(2))]
    command = (
        f"gateway udp --host 127.0.0.1 --port {ports[0]} --site {SITE} --connect {endpoint} --http-port {ports[1]}"
    )
    process = subprocess.Popen([sys.executable, "-m", "headway", *command.split()], stderr=subprocess.DEVNULL)
    url = f"http://127.0.0.1:{ports[1]}"
    for _ in range(300):
        try:
            scrape(f"{url}/readyz")
            break
        except OSError:
            time.sleep(0.1)
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sender.connect(("127.0.0.1", ports[0]))

    def end() -> dict[str, Any]:
        account = {
            name: value for name, value in scrape(f"{url}/metrics").items() if "gateway" in name or "cpu" in name
        }
        process.send_signal(signal.SIGTERM)
        process.wait(20.0)
        return account

    return lambda *message: sender.send(packet(*message)) and None, end


def direct(endpoint: str) -> tuple[Send, Callable[[], dict[str, Any]]]:
    """Return what puts bundles of 25 records on the bus."""
    session, key, waiting = connect(endpoint), Keys("v2x", SITE).bsm("gw-direct"), list[Any]()

    def send(vehicle: int, count: int, at_s: float, lat: float, lon: float) -> None:
        at_us = int(at_s * 1e3) * 1000
        waiting.append([1, f"{vehicle:08X}", count % 128, at_us, lat, lon, SPEED_MPS, 90.0, 260.0, 0.0, 1.0, 4.6, 1.9])
        if len(waiting) == 25:
            session.put(key, msgpack.packb(waiting), encoding=BSM_MSGPACK, congestion_control=BLOCK)
            waiting.clear()

    def end() -> dict[str, Any]:
        session.close()
        return {}

    return send, end


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vehicles", type=int, default=2000)
    parser.add_argument("--seconds", type=int, default=20)
    options = parser.parse_args()
    for way in (direct, through_gateway):
        settings = {"site": SITE, "vehicle_capacity": 2 * options.vehicles, "sender_rate_hz": 1_000_000}
        with running_service(settings) as child:
            send, end = way(child.endpoint)
            start_s = time.time() + 0.5
            sent = drive(options.vehicles, start_s, range(WARM_S), send)
            before = scrape(child.metrics_url)
            sent += drive(options.vehicles, start_s, range(WARM_S, WARM_S + options.seconds), send)
            time.sleep(1.0)
            after = scrape(child.metrics_url)
            outcomes = {
                name.partition('"')[2].rstrip('"}'): value
                for name, value in after.items()
                if name.startswith("headway_records_total") and value
            }
            found = {
                "way": way.__name__, "sent": sent, "outcomes": outcomes, "unaccounted": sent - sum(outcomes.values()),
                "latency_ms": {p: percentile_ms(before, after, p / 100) for p in (50, 99, 99.9)}, "gateway": end(),
                "service_cpu_us": 1e6 * (after[CPU] - before[CPU]) / (options.vehicles * RATE_HZ * options.seconds),
            }  # fmt: skip
            sys.stdout.write(json.dumps(found) + "\n")


if __name__ == "__main__":
    main()
