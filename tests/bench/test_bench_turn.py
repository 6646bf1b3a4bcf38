"""Cost of a whole turn of the loop, from bytes to what is published, and of a search for the leader."""

from collections.abc import Iterator
from itertools import islice

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture
from sim.rig import KEYS, Rig

from headway.core.engine import Engine
from headway.core.tracking import pairing
from headway.core.types.config import DetectorConfig
from headway.edge.transport.message import ReceivedMessage
from headway_loadtest.traffic.encode import Encoder
from headway_loadtest.traffic.fleet import FleetFrames
from headway_loadtest.traffic.schedule import Schedule
from headway_schemas.encodings import BSM_MSGPACK

pytestmark = pytest.mark.bench
START_US = 1_700_000_000_000_000
VEHICLES = 2_000
WARM_S = 4


def received_messages(bundle: int) -> Iterator[ReceivedMessage]:
    schedule = Schedule(start_ns=0, start_unix_us=START_US)
    for batch in Encoder(KEYS, bundle=bundle).batches(FleetFrames(VEHICLES, 60.0), schedule):
        for key, payload in zip(batch.keys, batch.payloads, strict=True):
            received_us = START_US + batch.due_ns // 1000
            yield ReceivedMessage(str(key), payload, BSM_MSGPACK, True, received_us, batch.due_ns)


def rig_after(stream: Iterator[ReceivedMessage], messages: int) -> Rig:
    rig = Rig(Engine(DetectorConfig(vehicle_capacity=VEHICLES)), batch_limit=100_000)
    for _ in range(0, messages, 200):
        take(rig, stream, 200)
        rig.loop.iterate()
    return rig


def take(rig: Rig, stream: Iterator[ReceivedMessage], messages: int) -> None:
    taken = list(islice(stream, messages))
    rig.clock._elapsed_us = taken[-1].received_ns // 1000
    rig.bus._receive_queue.put(taken)


@pytest.mark.parametrize("bundle", [1, 25])
@pytest.mark.parametrize("records", [25, 250, 2_500])
def test_a_turn(benchmark: BenchmarkFixture, records: int, bundle: int) -> None:
    messages = records // bundle
    stream = received_messages(bundle)
    rig = rig_after(stream, WARM_S * 10 * VEHICLES // bundle)
    benchmark.extra_info["readings"] = records
    rounds = max(10, min(400, 50 * 10 * VEHICLES // records))
    benchmark.pedantic(rig.loop.iterate, setup=lambda: take(rig, stream, messages), rounds=rounds)
    assert rig.ledger.records == rig.ledger.scored + rig.ledger.warming


def test_a_search_for_the_leader(benchmark: BenchmarkFixture) -> None:
    stream = received_messages(1)
    engine = rig_after(stream, WARM_S * 10 * VEHICLES).engine
    tables = engine._site.tables
    rows = np.arange(VEHICLES)
    none, changed = np.full(VEHICLES, pairing.NO_LEADER), np.empty(VEHICLES, np.bool_)
    now_us = int(tables.tracks["received_us"].max())

    def prepare() -> None:
        tables.pairing["search_us"] = 0

    benchmark.extra_info["readings"] = VEHICLES
    benchmark.pedantic(
        pairing.find_leaders,
        (tables.tracks, tables.pairing, tables.grid, rows, none, now_us, 200.0, 3.5, changed),
        setup=prepare,
        rounds=100,
        warmup_rounds=2,
    )
    assert engine.pairs > 0.8 * VEHICLES
