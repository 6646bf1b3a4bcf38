"""A service as one would write it first: in zenoh's callback, pydantic for each message, filterpy for each vehicle.

It says of itself what the load test asks of a service, so that both are judged by the same judge.
Arguments: an endpoint to listen on, a site, and the class of `ordinary` that judges.
"""

import json
import signal
import sys
import threading
import time
from typing import Any

import msgpack
import numpy as np
import zenoh
from bench import ordinary
from bench.peers.job import Latencies

from headway.edge.telemetry.process import rss_mb
from headway_loadtest.measure.result import INTENDED
from headway_schemas import Keys
from headway_schemas.bsm import Bsm, from_record

METRES_PER_DEGREE = 111_000.0


class Naive:
    """Every vehicle follows a point 30 m ahead of its first filter's estimate; who leads is nobody's concern."""

    def __init__(self, kind: Any) -> None:
        self._kind = kind
        self._pairs: dict[str, Any] = {}
        self.scored = self.anomalous = 0
        self._latencies = Latencies()

    def take(self, sample: zenoh.Sample) -> None:
        content = msgpack.unpackb(sample.payload.to_bytes())
        for record in content if isinstance(content[0], list) else [content]:
            self._detect(from_record(record))

    def _detect(self, bsm: Bsm) -> None:
        x_m = bsm.lat * METRES_PER_DEGREE
        if bsm.id not in self._pairs:
            self._pairs[bsm.id] = self._kind(x_m, bsm.speed_mps)
        z = np.array([x_m, bsm.speed_mps])
        self.anomalous += self._pairs[bsm.id].step(z, (x_m + 30.0, bsm.speed_mps))
        self.scored += 1
        self._latencies.add(bsm.t_us)

    def health(self) -> str:
        counters = {"scored": self.scored, "warming": 0, "rejected": {}, "lost": {}, "sequence_gap_messages": 0}
        used = {"cpu_s": time.process_time(), "rss_mb": rss_mb()}
        histograms = {INTENDED: list(self._latencies.buckets.copy().items())}
        return json.dumps(counters | used | {"instance": "naive", "queue_depth": 0, "histograms_us": histograms})


def main(endpoint: str, site: str, kind: str) -> None:
    stop = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: stop.set())
    config = zenoh.Config()
    for key, value in (("mode", "peer"), ("listen/endpoints", [endpoint]), ("scouting/multicast/enabled", False)):
        config.insert_json5(key, json.dumps(value))
    keys, naive = Keys("v2x", site), Naive(getattr(ordinary, kind))
    with zenoh.open(config) as session:
        subscriber = session.declare_subscriber(keys.every_bsm, naive.take)
        while not stop.wait(0.5):
            session.put(keys.health("naive"), naive.health())
        subscriber.undeclare()


if __name__ == "__main__":
    main(*sys.argv[1:])
