import json
import socket
import threading
import time

import msgpack
import pytest
import zenoh

from headway_loadtest.inject.faults import Kind, Spec
from headway_loadtest.measure.result import INTENDED
from headway_loadtest.run import Plan, run
from headway_loadtest.traffic.fleet import FleetFrames
from headway_loadtest.traffic.session import SessionError, connect
from headway_schemas import Keys

KEYS = Keys("v2x", "crossing")
LOST_ONE_IN = 50


def free_endpoint():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


class StandIn:
    """Counts records as a service would, ignores one in 50 as if it were lost, and calls speeds above 60 m/s a lie."""

    def __init__(self, endpoint):
        config = zenoh.Config()
        for key, value in (
            ("mode", "peer"),
            ("listen/endpoints", [endpoint]),
            ("scouting/multicast/enabled", False),
        ):
            config.insert_json5(key, json.dumps(value))
        self.session = zenoh.open(config)
        self.seen = self.scored = self.missed = 0
        self.suspects = {}
        self.stop = threading.Event()
        self.thread = threading.Thread(target=self.report)
        self.session.declare_subscriber(KEYS.every_bsm, self.step)

    def step(self, sample):
        _, vehicle, _, t_us, _, _, speed_mps, *_ = msgpack.unpackb(sample.payload.to_bytes())
        self.seen += 1
        if self.seen % LOST_ONE_IN == 0:
            self.missed += 1
            return
        self.scored += 1
        if speed_mps > 60.0:
            self.suspects.setdefault(vehicle, t_us)

    def report(self):
        published = set()
        while not self.stop.wait(0.1):
            for vehicle in sorted(set(self.suspects) - published):
                published.add(vehicle)
                self.session.put(KEYS.alert("bias", vehicle), self.event(vehicle))
            self.session.put(KEYS.health("i"), self.health())

    def event(self, vehicle):
        fields = {"event_id": vehicle, "phase": "onset", "kind": "bias", "sensor": "speed", "site": "crossing"}
        fields |= {"suspect": vehicle, "follower": vehicle, "model": "m", "config_hash": "h"}
        return json.dumps(fields | {"t_us": self.suspects[vehicle], "detected_us": self.suspects[vehicle]})

    def health(self):
        counters = {
            "scored": self.scored,
            "warming": 0,
            "rejected": {},
            "lost": {},
            "sequence_gap_messages": self.missed,
        }
        others = {"instance": "i", "queue_depth": 0, "cpu_s": time.process_time(), "rss_mb": 1.0}
        return json.dumps(counters | others | {"histograms_us": {INTENDED: [(500.0, self.scored)]}})

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.stop.set()
        self.thread.join()
        self.session.close()


def test_a_run_over_zenoh_is_judged_to_the_last_message():
    endpoint = free_endpoint()
    frames = FleetFrames(40, 1.5, seed=1, inject=Spec(kinds=(Kind.BIAS,), c=10_000.0, p=0.02))
    progress = []
    with StandIn(endpoint) as service, connect(endpoint) as session:
        outcome = run(session, frames, KEYS, Plan(warmup_s=0.5), progress.append)
    assert outcome.sent == service.seen == 600
    assert outcome.service is not None
    ledger = outcome.service.ledger
    assert (ledger.scored, ledger.lost, ledger.unaccounted) == (588, {"transport": 12}, 0)
    assert outcome.latency is not None
    assert outcome.latency.p99 == 0.5
    assert outcome.service.cpu_us is not None
    assert outcome.late is not None
    assert outcome.late.count == 400
    assert outcome.quality.events == len(frames.labels)
    assert outcome.quality.found > 0
    assert outcome.quality.false_alarms == 0
    assert outcome.alerts == len(service.suspects)
    assert progress[-1].sent > 500


def test_nobody_at_the_other_end_is_one_line(monkeypatch):
    monkeypatch.setattr("headway_loadtest.traffic.session.CONNECT_S", 0.3)
    endpoint = free_endpoint()
    with pytest.raises(SessionError) as caught:
        connect(endpoint)
    assert f"nothing answers at {endpoint} within 0.3 s: start `headway serve`" in str(caught.value)
    assert "\n" not in str(caught.value)
