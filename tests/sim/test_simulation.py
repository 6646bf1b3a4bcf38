"""The production loop in a simulated world: whatever the network does, every delivered record has one outcome."""

from dataclasses import replace

import pytest
from sim.world import SimWorld

from headway.core.types.config import DetectorConfig
from headway.core.types.outcome import Outcome
from headway.edge.codec.decoded import Decoded
from headway.edge.transport.message import ReceivedMessage
from headway.edge.transport.ports import Channel


def world(seed: int, **changes) -> SimWorld:
    simulated = SimWorld(seed, **changes)
    simulated.drive(vehicles=8, seconds=12.0)
    return simulated


@pytest.mark.parametrize("seed", range(4))
def test_every_delivered_record_has_exactly_one_outcome(seed: int) -> None:
    simulated = world(seed)
    ledger, bus = simulated.rig.ledger, simulated.rig.bus
    assert ledger.records == simulated.records > 900
    assert bus.received == ledger.messages
    assert ledger.scored > 200
    assert {Outcome.WARMING, Outcome.DUPLICATE, Outcome.OUT_OF_ORDER} <= {o for o in Outcome if ledger[o]}


@pytest.mark.parametrize("seed", range(4))
def test_what_cannot_be_read_is_rejected_for_its_reason(seed: int) -> None:
    simulated = world(seed, garbled=0.5)
    counted = {reason: simulated.rig.ledger[reason] for reason in simulated.spoilt}
    assert counted == simulated.spoilt
    assert len(counted) == 11


def test_the_same_seed_gives_the_same_run_to_the_last_bit() -> None:
    assert world(7).digest() == world(7).digest()
    assert world(7).digest() != world(8).digest()


def test_on_a_perfect_network_each_record_has_a_verdict_and_none_an_alarm() -> None:
    simulated = SimWorld(3, loss=0.0, delay_s=(0.001, 0.002), doubled=0.0, garbled=0.0)
    simulated.drive(vehicles=4, seconds=12.0)
    ledger = simulated.rig.ledger
    assert ledger.scored + ledger.warming == ledger.records == simulated.records
    assert {alert["suspect"] for alert in simulated.published(Channel.ALERT) if alert["kind"] != "miss"} == set()


def test_what_a_full_queue_sheds_is_accounted_for_by_its_records() -> None:
    simulated = world(5, queue_limit=1, garbled=0.2)
    ledger, bus = simulated.rig.ledger, simulated.rig.bus
    assert bus.shed > 50
    assert ledger.lost == {"shed": bus.shed_records[Outcome.SHED], "stale": 0, "rate_exceeded": 0}
    assert ledger.records == simulated.records
    assert bus.received == ledger.messages + bus.shed


def test_more_vehicles_than_rows_are_refused_by_name() -> None:
    simulated = world(6, detector=DetectorConfig(vehicle_capacity=4))
    assert simulated.rig.ledger[Outcome.TABLE_FULL] > 100
    assert simulated.rig.ledger.records == simulated.records


def test_states_and_health_are_published_throughout() -> None:
    simulated = world(2)
    assert len(simulated.published(Channel.HEALTH)) >= 12
    assert {state["follower"] for state in simulated.published(Channel.STATE)} >= {f"car{n}" for n in range(8)}


def test_a_loop_that_falls_behind_processes_the_fresh_without_alarms_and_soon_catches_up() -> None:
    simulated = SimWorld(9, loss=0.0, delay_s=(0.001, 0.002), doubled=0.0, garbled=0.0)
    rig, waited_s = simulated.rig, []
    decode = rig.codec.decode

    def decoded(received_messages: list[ReceivedMessage], clock_offset_us: int) -> Decoded:
        now_s = rig.clock.monotonic_ns() / 1e9
        waited_s.extend((now_s, now_s - received.received_ns / 1e9) for received in received_messages)
        limit = 1 if now_s < 10.0 else 100  # at 50 turns a second, half of what comes in
        rig.loop._config = replace(rig.loop._config, batch_limit=limit)
        return decode(received_messages, clock_offset_us)

    rig.codec.decode = decoded
    simulated.drive(vehicles=10, seconds=15.0)
    ledger, bus = rig.ledger, rig.bus
    assert max(wait_s for _, wait_s in waited_s) == pytest.approx(1.0, abs=0.02)
    assert max(wait_s for now_s, wait_s in waited_s if now_s > 10.1) < 0.03
    assert ledger.lost == {"shed": 0, "stale": bus.shed_records[Outcome.STALE], "rate_exceeded": 0}
    assert ledger[Outcome.STALE] > 300
    assert ledger.records == simulated.records
    missed = {alert["suspect"] for alert in simulated.published(Channel.ALERT) if alert["kind"] == "miss"}
    assert missed <= {f"car{n}-neighbour" for n in range(10)}, "who sends at every step was never silent"
    assert simulated.published(Channel.HEALTH)[-1]["lost"] == ledger.lost
