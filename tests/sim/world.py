"""A world from a seed: drivers, a network that loses, delays, doubles and garbles, and the production loop."""

import hashlib
import heapq
import json
import math
from collections import Counter
from collections.abc import Iterator
from itertools import count
from typing import Any

import msgpack
import numpy as np
from sim.clock import START_US
from sim.rig import KEYS, Rig

from headway.core.engine import Engine
from headway.core.types.config import DetectorConfig
from headway.core.types.outcome import Outcome
from headway.edge.transport.message import ReceivedMessage
from headway.edge.transport.ports import Channel
from headway_schemas.bsm import FIELDS
from headway_schemas.encodings import BSM_JSON, BSM_MSGPACK

ITERATION_S = 0.02
GAP_M, SPEED_MPS = 25.0, 15.0
METRES_PER_DEGREE = 111_000.0
GATEWAY = "gw-1"


class SimWorld:
    """Vehicles in platoons of four; what reaches the bus is counted by its records, and what was spoilt by reason."""

    def __init__(
        self,
        seed: int,
        *,
        loss: float = 0.05,
        delay_s: tuple[float, float] = (0.001, 0.3),
        doubled: float = 0.03,
        garbled: float = 0.05,
        queue_limit: int = 100_000,
        detector: DetectorConfig | None = None,
    ) -> None:
        self._rng = np.random.default_rng(seed)
        self._loss, self._delay_s, self._doubled, self._garbled = loss, delay_s, doubled, garbled
        config = detector or DetectorConfig(vehicle_capacity=32)
        self.rig = Rig(Engine(config), queue_limit=queue_limit, state_rate_hz=1.0)
        self.records = 0
        """Records delivered to the bus."""
        self.spoilt: Counter[Outcome] = Counter()
        """Records delivered that cannot be read, by the reason they must be given."""
        self._air: list[tuple[float, int, ReceivedMessage, int, Outcome | None]] = []
        self._order = count()

    def drive(self, vehicles: int, seconds: float, rate_hz: float = 10.0) -> None:
        """Let everybody drive and send, and the loop turn, then wait until nothing is in the air."""
        for k in range(round(seconds * rate_hz)):
            for vehicle in range(vehicles):
                self._send(vehicle, k, k / rate_hz + vehicle / vehicles / rate_hz)
        self.iterate_until_silent()

    def iterate_until_silent(self) -> None:
        """Deliver what is due before each turn."""
        clock = self.rig.clock
        while self._air or self.rig.bus.waiting:
            for received, records, reason in self.due():
                self.rig.bus.deliver(received._replace(received_us=clock.local_us(), received_ns=clock.monotonic_ns()))
                self.records += records
                if reason is not None:
                    self.spoilt[reason] += records
            self.iterate()
            clock.sleep(ITERATION_S)

    def due(self) -> Iterator[tuple[ReceivedMessage, int, Outcome | None]]:
        """Yield what arrives by now: a message, its records, and why they cannot be read."""
        while self._air and self._air[0][0] <= self.rig.clock.monotonic_ns() / 1e9:
            _, _, received, records, reason = heapq.heappop(self._air)
            yield received, records, reason

    def iterate(self) -> None:
        """Iterate once."""
        self.rig.loop.iterate()

    def digest(self) -> str:
        """All that the service published and counted, without what health reports say about the machine."""
        digest = hashlib.sha256()
        for channel, key, payload in self.rig.bus.published:
            message = json.loads(payload)
            for name in ("rss_mb", "cpu_s"):
                message.pop(name, None)
            digest.update(f"{channel.name} {key} {json.dumps(message, sort_keys=True)}".encode())
        digest.update(repr([self.rig.ledger[outcome] for outcome in Outcome]).encode())
        return digest.hexdigest()

    def published(self, channel: Channel) -> list[dict[str, Any]]:
        """The messages of a channel."""
        return [json.loads(payload) for _, payload in self.rig.bus.on(channel)]

    def _send(self, vehicle: int, k: int, at_s: float) -> None:
        record = self._record(vehicle, k, at_s)
        name = record[1]
        received, records = self._wrapped(record)
        if self._rng.random() < self._loss:
            return
        reason = None
        if self._rng.random() < self._garbled:
            received, records, reason = self._garble(name, record)
        for _ in range(2 if self._rng.random() < self._doubled else 1):
            due_s = at_s + self._rng.uniform(*self._delay_s)
            heapq.heappush(self._air, (due_s, next(self._order), received, records, reason))

    def _record(self, vehicle: int, k: int, at_s: float) -> list[Any]:
        lane, place = divmod(vehicle, 4)
        wave = 2.0 * math.sin(0.3 * at_s - 0.2 * place)
        y_m = SPEED_MPS * at_s - GAP_M * place - 2.0 / 0.3 * math.cos(0.3 * at_s - 0.2 * place)
        speed_mps = max(0.0, SPEED_MPS + wave + self._rng.normal(0.0, 0.02))
        lat = 42.0 + (y_m + self._rng.normal(0.0, 0.02)) / METRES_PER_DEGREE
        t_us = START_US + round(at_s * 1e6)
        return [1, f"car{vehicle}", k % 128, t_us, lat, -83.0 + 0.01 * lane, speed_mps, 0.0, None, None, None, 4.5]

    def _wrapped(self, record: list[Any]) -> tuple[ReceivedMessage, int]:
        """Choose a form: compact, a map, JSON, or a bundle of a gateway with the record of a neighbour in it."""
        as_map = {name: value for name, value in zip(FIELDS, record, strict=False) if value is not None}
        match self._rng.integers(4):
            case 0:
                return _received(record[1], msgpack.packb(record)), 1
            case 1:
                return _received(record[1], msgpack.packb(as_map)), 1
            case 2:
                return _received(record[1], json.dumps(as_map).encode(), BSM_JSON), 1
            case _:
                peer = [1, f"{record[1]}-neighbour", *record[2:5], record[5] + 0.005, *record[6:]]
                return _received(GATEWAY, msgpack.packb([record, peer])), 2

    def _garble(self, name: str, record: list[Any]) -> tuple[ReceivedMessage, int, Outcome]:
        whole = msgpack.packb(record)
        spoilt: list[tuple[ReceivedMessage, int, Outcome]] = [
            (_received(name, whole[:-1]), 1, Outcome.MALFORMED),
            (_received(name, b""), 1, Outcome.MALFORMED),
            (_received(name, msgpack.packb([9, *record[1:]])), 1, Outcome.WRONG_VERSION),
            (_received(name, msgpack.packb([*record[:4], 91.0, *record[5:]])), 1, Outcome.OUT_OF_RANGE),
            (_received(name, msgpack.packb([*record[:4], math.nan, *record[5:]])), 1, Outcome.NOT_FINITE),
            (_received(name, msgpack.packb([*record[:6], None, *record[7:]])), 1, Outcome.UNAVAILABLE),
            (_received("impostor", whole), 1, Outcome.IDENTITY_MISMATCH),
            (_received("*", whole), 1, Outcome.WILDCARD_KEY),
            (_received(name, whole)._replace(is_put=False), 1, Outcome.NOT_A_PUT),
            (_received(name, whole, "text/plain"), 1, Outcome.UNKNOWN_ENCODING),
            (_received(name, bytes(70_000)), 1, Outcome.PAYLOAD_TOO_LARGE),
            (_received(GATEWAY, msgpack.packb([[1]] * 600)), 600, Outcome.BUNDLE_TOO_LARGE),
        ]
        return spoilt[self._rng.integers(len(spoilt))]


def _received(sender: str, payload: bytes, encoding: str = BSM_MSGPACK) -> ReceivedMessage:
    return ReceivedMessage(f"{KEYS.prefix}/{KEYS.site}/bsm/{sender}", payload, encoding, True, 0, 0)
