"""One recording three ways: the service on its bus, `headway judge`, and the detector as a library."""

import json
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest
from made_recording import made_recording
from sim.rig import KEYS, Rig
from typer.testing import CliRunner

from headway.cli.app import app
from headway.core.engine import Engine
from headway.core.types.config import DetectorConfig
from headway.detector import Detector
from headway.edge.codec.evidence import parameters
from headway.edge.identity import Identity
from headway.edge.transport.message import ReceivedMessage
from headway.edge.transport.ports import Channel
from headway.kernel_cache import core_digest
from headway.settings import config_hash
from headway.version import version
from headway_schemas.bsm import from_map, to_record
from headway_schemas.encodings import BSM_JSON, BSM_MSGPACK

CONFIG = DetectorConfig()
RECORDS = made_recording(6, 24.0, fault=(9.0, 13.0))
RECORDS = [r for r in RECORDS if not (r["id"] == "car3" and 1_700_000_016_000_000 < r["t_us"] < 1_700_000_017_500_000)]
IDENTITY = Identity(
    site="s",
    instance="i",
    version=version(),
    model=CONFIG.model,
    config_hash=config_hash(CONFIG),
    parameters=parameters(CONFIG, version(), core_digest()),
)


def comparable(event: dict[str, Any]) -> dict[str, Any]:
    """Leave out what a clock shows, what numbers the updates of a process, and original messages: a record has none."""
    own = ("detected_us", "latency_us", "instance", "sequence")
    left = {name: value for name, value in event.items() if name not in own}
    if left["evidence"] is not None:
        left["evidence"] = left["evidence"] | {"messages": None}
    return left


def by_service(seed: int) -> list[dict[str, Any]]:
    """Deliver each message when it was received, and let the loop turn at irregular times."""
    rng = np.random.default_rng(seed)
    rig = Rig(Engine(CONFIG), identity=IDENTITY)
    waiting = RECORDS[::-1]
    while waiting or rig.engine.vehicles:
        while waiting and waiting[-1]["received_us"] <= rig.clock.wall_us():
            record = waiting.pop()
            bsm = {name: value for name, value in record.items() if name != "received_us"}
            payload, encoding = json.dumps(bsm).encode(), BSM_JSON
            if rng.random() < 0.5:
                payload, encoding = msgpack.packb(to_record(from_map(bsm))), BSM_MSGPACK
            key, received_us = KEYS.bsm(bsm["id"]), record["received_us"]
            rig.bus.deliver(ReceivedMessage(key, payload, encoding, True, received_us, rig.clock.monotonic_ns()))
        rig.loop.iterate()
        rig.clock.sleep(float(rng.choice([0.0005, 0.002, 0.03])))
    return [json.loads(payload) for _, payload in rig.bus.on(Channel.ALERT)]


def by_judge(folder: Path) -> list[dict[str, Any]]:
    recording, events = folder / "road.jsonl", folder / "events.jsonl"
    recording.write_text("".join(json.dumps(record) + "\n" for record in RECORDS))
    ran = CliRunner().invoke(app, ["judge", str(recording), "--set", "site=s", "--events", str(events), "--json"])
    assert ran.exit_code == 0
    return [json.loads(line) for line in events.read_text().splitlines()]


def by_detector(size: int) -> list[dict[str, Any]]:
    detector = Detector(site="s")
    results = [detector.process(RECORDS[k : k + size]) for k in range(0, len(RECORDS), size)] + [detector.finish()]
    return [json.loads(event.model_dump_json()) for result in results for event in result.events]


@pytest.mark.parametrize("seed", [1, 2])
def test_service_judge_and_detector_give_the_same_events(tmp_path: Path, seed: int) -> None:
    by_library = by_detector(7)
    assert by_judge(tmp_path) == by_library
    assert {event["kind"] for event in by_library} >= {"miss"}
    assert {event["suspect"] for event in by_library} >= {"car1", "car3"}
    assert list(map(comparable, by_service(seed))) == list(map(comparable, by_library))
