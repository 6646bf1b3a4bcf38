"""The turn: what comes in is judged, what is found is told, and everything is in the books."""

import json
from collections import Counter

import msgpack
import pytest
from edge.codec.messages import ids_of, received, record
from edge.stub import StubEngine, event
from sim.clock import FakeClock
from sim.memory_bus import MemoryQuery
from sim.rig import KEYS, Rig

from headway.core.types.outcome import Outcome
from headway.core.types.records import Sensor
from headway.edge.codec.messages import DETAILS
from headway.edge.event_updates import AT_ONCE, SHARE_AT_ONCE
from headway.edge.transport.ports import Channel
from headway_schemas import Event, Health, PairState, RejectedCopy, SensorQuality


def run(rig: Rig, iterations: int) -> None:
    left = iter(range(iterations))
    rig.loop.run(lambda: next(left, None) is None)


def test_a_turn_hands_what_has_come_to_the_detector_in_one_batch() -> None:
    rig = Rig(StubEngine())
    rig.bus.deliver(received(record("a"), "a"))
    rig.bus.deliver(received([record("b"), record("c")], "gw-1"))
    assert rig.loop.iterate() == 2
    assert [ids_of(batch.ids) for batch in rig.engine.batches] == [["a", "b", "c"]]
    assert (rig.ledger.messages, rig.ledger.scored, rig.ledger.records) == (2, 3, 3)


def test_a_turn_takes_no_more_than_the_limit() -> None:
    rig = Rig(StubEngine(), batch_limit=2)
    for _ in range(5):
        rig.bus.deliver(received(record()))
    assert [rig.loop.iterate() for _ in range(4)] == [2, 2, 1, 0]


def test_without_messages_time_passes_for_the_detector_but_not_in_every_turn() -> None:
    rig = Rig(StubEngine())
    rig.iterate(seconds=1.0, step_s=0.001)
    assert len(rig.engine.batches) == 50


def test_onsets_of_all_vehicles_at_once_are_published_over_turns_that_go_on_to_judge() -> None:
    rig = Rig(StubEngine())
    rig.engine.events = [event(event_id=f"car{n}-5", suspect=f"car{n}") for n in range(2_000)]
    each_turn = []
    while sum(each_turn) < 2_000:
        rig.bus.deliver(received(record("a"), "a"))
        before = len(rig.bus.on(Channel.ALERT))
        assert rig.loop.iterate() == 1
        each_turn.append(len(rig.bus.on(Channel.ALERT)) - before)
    assert max(each_turn) == SHARE_AT_ONCE * 2_000
    assert min(each_turn[:-1]) == AT_ONCE
    assert len(each_turn) < 2_000 / AT_ONCE
    assert rig.ledger.scored == len(each_turn)
    published = [Event.model_validate_json(payload) for _, payload in rig.bus.on(Channel.ALERT)]
    assert [one.suspect for one in published] == [f"car{n}" for n in range(2_000)]
    assert [one.sequence for one in published] == list(range(1, 2_001))


def test_a_loop_that_stops_publishes_what_waits_first() -> None:
    rig = Rig(StubEngine())
    rig.engine.events = [event(event_id=f"car{n}-5", suspect=f"car{n}") for n in range(200)]
    rig.loop.iterate()
    rig.loop.drain(timeout_s=1.0)
    assert len(rig.bus.on(Channel.ALERT)) == 200


def test_an_event_goes_to_its_alert_topic_with_the_way_it_took() -> None:
    rig = Rig(StubEngine())
    sent = received(record("car1"), "car1")
    rig.bus.deliver(sent)
    rig.engine.events = [event(t_us=sent.received_us - 7, received_us=rig.clock.wall_us() - 500)]
    rig.loop.iterate()
    [(key, payload)] = rig.bus.on(Channel.ALERT)
    published = Event.model_validate_json(payload)
    assert key == KEYS.alert("bias", "car1")
    assert (published.phase, published.kind, published.sensor, published.site, published.config_hash) == (
        "onset", "bias", "location", "s", "c0ffee",
    )  # fmt: skip
    assert published.latency_us == {"wire": -493, "queue": 500, "decode": 0, "detect": 0}
    assert published.recovered.v_std_mps is None
    assert (published.evidence.columns[0], published.evidence.columns[-1]) == ("t_s", "leader_row")
    assert [len(reading) for reading in published.evidence.readings] == [len(published.evidence.columns)] * 3


def test_a_miss_was_in_no_queue() -> None:
    rig = Rig(StubEngine())
    rig.engine.events = [event(evidence=None, sensor=Sensor.LINK, nis=float("nan"))]
    rig.bus.deliver(received(record()))
    rig.loop.iterate()
    published = Event.model_validate_json(rig.bus.on(Channel.ALERT)[0][1])
    assert "queue" not in published.latency_us
    assert published.nis is None


def test_a_rejection_by_the_codec_is_counted_in_full_and_copied_at_a_limited_rate_and_size() -> None:
    rig = Rig(StubEngine(), rejected_rate_hz=3.0)
    for _ in range(10):
        rig.bus.deliver(received(b"\xc1 no msgpack at all"))
    rig.loop.iterate()
    copies = [RejectedCopy.model_validate_json(payload) for _, payload in rig.bus.on(Channel.REJECTED)]
    assert [(c.reason, c.payload, c.truncated) for c in copies] == [("malformed", b"\xc1 no msg", True)] * 3
    assert rig.ledger.rejected == {"malformed": 10}
    assert rig.ledger.copies_withheld == 7
    rig.clock.sleep(1.0)
    rig.bus.deliver(received(b"\xc1"))
    rig.loop.iterate()
    assert len(rig.bus.on(Channel.REJECTED)) == 4


def test_each_reason_has_a_rate_of_its_own() -> None:
    rig = Rig(StubEngine(), rejected_rate_hz=1.0)
    for sent in (received(b"\xc1"), received(b"\xc1"), received(record("b"), "a"), received(record(), is_put=False)):
        rig.bus.deliver(sent)
    rig.loop.iterate()
    reasons = Counter(key.rpartition("/")[2] for key, _ in rig.bus.on(Channel.REJECTED))
    assert reasons == {"malformed": 1, "identity_mismatch": 1, "not_a_put": 1}


def test_there_is_a_word_for_every_rejection_of_the_core() -> None:
    assert set(DETAILS) == {outcome for outcome in Outcome if 30 <= outcome < 40}


@pytest.mark.parametrize("reason", list(DETAILS))
def test_a_rejection_by_the_core_is_copied_with_the_payload_it_came_in(reason: Outcome) -> None:
    rig = Rig(StubEngine())
    rig.bus.deliver(received(record("a"), "a"))
    rig.bus.deliver(received(record("b"), "b"))
    rig.engine.outcomes = [Outcome.SCORED, reason]
    rig.loop.iterate()
    [(key, payload)] = rig.bus.on(Channel.REJECTED)
    assert key == KEYS.rejected(reason.label)
    assert RejectedCopy.model_validate_json(payload).sender == "b"
    assert rig.ledger.rejected == {reason.label: 1}


def test_no_copy_is_made_that_nobody_wants() -> None:
    rig = Rig(StubEngine())
    rig.bus.unwanted.add(Channel.REJECTED)
    rig.bus.deliver(received(b"\xc1"))
    rig.loop.iterate()
    assert rig.bus.on(Channel.REJECTED) == []
    assert rig.ledger.rejected == {"malformed": 1}


def test_each_vehicle_is_told_of_once_a_second_and_not_all_at_once() -> None:
    rig = Rig(StubEngine(vehicles=200), state_rate_hz=1.0)
    rig.iterate(seconds=0.5)
    half = len(rig.bus.on(Channel.STATE))
    assert 0.4 * 200 < half < 0.6 * 200
    rig.iterate(seconds=2.0)
    published = [PairState.model_validate_json(payload) for _, payload in rig.bus.on(Channel.STATE)]
    assert set(Counter(state.follower for state in published).values()) <= {2, 3}
    standings = {state.follower: state.standing for state in published}
    assert [standings[f"car{n}"] for n in range(4)] == ["warming", "anomalous", "silent", "normal"]


def test_many_vehicles_are_told_of_at_the_budget() -> None:
    rig = Rig(StubEngine(vehicles=2_000), state_rate_hz=1.0, state_budget_hz=500.0)
    rig.iterate(seconds=2.0)
    assert len(rig.bus.on(Channel.STATE)) == pytest.approx(1_000, rel=0.1)


@pytest.mark.parametrize("rate_hz", [0.0, 1.0])
def test_no_state_is_told_that_nobody_wants(rate_hz: float) -> None:
    rig = Rig(StubEngine(vehicles=100), state_rate_hz=rate_hz)
    if rate_hz:
        rig.bus.unwanted.add(Channel.STATE)
    rig.iterate(seconds=2.0)
    assert rig.bus.on(Channel.STATE) == []


def test_the_quality_of_each_vehicles_sensors_is_published_every_ten_seconds() -> None:
    rig = Rig(StubEngine(vehicles=100))
    rig.iterate(seconds=10.2)
    published = [SensorQuality.model_validate_json(payload) for _, payload in rig.bus.on(Channel.QUALITY)]
    assert {quality.vehicle for quality in published} == {f"car{n}" for n in range(100)}
    assert len(published) == pytest.approx(100, abs=5)
    assert {quality.vehicle: quality.level for quality in published}["car1"] == "degraded"
    assert rig.bus.on(Channel.QUALITY)[0][0] == KEYS.quality(published[0].vehicle)


def test_no_quality_is_published_that_nobody_wants() -> None:
    rig = Rig(StubEngine(vehicles=100))
    rig.bus.unwanted.add(Channel.QUALITY)
    rig.iterate(seconds=3.0)
    assert rig.bus.on(Channel.QUALITY) == []


def test_the_question_for_all_pairs_is_answered_once_with_every_vehicle() -> None:
    rig = Rig(StubEngine(vehicles=150))
    query = MemoryQuery(KEYS.pairs)
    rig.bus.queries.append(query)
    rig.iterate(seconds=0.2)
    [answer] = query.answers
    assert {state["follower"] for state in json.loads(answer)} == {f"car{n}" for n in range(150)}


def test_health_is_told_every_second_from_the_same_books() -> None:
    rig = Rig(StubEngine())
    rig.iterate(seconds=0.1)
    for sent in (received(record()), received(b"\xc1")):
        rig.bus.deliver(sent)
    rig.iterate(seconds=2.0)
    reports = [Health.model_validate_json(payload) for _, payload in rig.bus.on(Channel.HEALTH)]
    assert len(reports) == 3
    assert (reports[-1].scored, reports[-1].rejected, reports[-1].lost) == (
        1,
        {"malformed": 1},
        {"shed": 0, "stale": 0, "rate_exceeded": 0},
    )
    assert reports[-1].ready
    assert [set(report.latency_ms) for report in reports] == [set(), {"p50", "p99", "p999", "max"}, set()]


def test_health_names_another_service_of_the_site() -> None:
    rig = Rig(StubEngine())
    rig.bus.other_services = ("rsu-2",)
    rig.iterate(seconds=0.1)
    [(_, payload)] = rig.bus.on(Channel.HEALTH)
    assert Health.model_validate_json(payload).troubles == ("site: rsu-2 judges it too",)


def test_what_was_shed_is_in_the_books() -> None:
    rig = Rig(StubEngine(), queue_limit=2)
    rig.bus.deliver(received([record("b"), record("c")], "gw-1"))
    for _ in range(2):
        rig.bus.deliver(received(record()))
    rig.loop.iterate()
    assert rig.ledger.lost == {"shed": 1, "stale": 0, "rate_exceeded": 0}, "of the sender with more than its share"
    assert rig.ledger.scored == 3
    assert rig.bus.received == rig.ledger.messages + rig.bus.shed + rig.bus.waiting


def test_silence_is_not_held_against_anybody_while_messages_wait_or_after_they_were_shed() -> None:
    rig = Rig(StubEngine(), batch_limit=2)
    sent = []
    for _ in range(3):
        rig.clock.sleep(0.3)
        sent.append(received(record())._replace(received_us=rig.clock.wall_us(), received_ns=rig.clock.monotonic_ns()))
        rig.bus.deliver(sent[-1])
    rig.clock.sleep(0.1)
    assert rig.loop.iterate() == 2
    assert rig.engine.now_us == [sent[1].received_us]
    assert rig.loop.iterate() == 1
    assert rig.engine.now_us[-1] == rig.clock.wall_us()
    assert rig.engine.gaps_ignored_before_us == []
    rig.bus.deliver(sent[-1])
    rig.clock.sleep(2.0)
    assert rig.loop.iterate() == 0
    assert rig.ledger.lost == {"shed": 0, "stale": 1, "rate_exceeded": 0}
    assert rig.engine.gaps_ignored_before_us == [rig.clock.wall_us()]


def test_the_time_in_the_queue_is_counted_from_the_receipt() -> None:
    rig = Rig(StubEngine())
    rig.clock.sleep(0.040)
    rig.bus.deliver(received(record())._replace(received_us=rig.clock.local_us() - 25_000))
    rig.loop.iterate()
    [(_, payload)] = rig.bus.on(Channel.HEALTH)
    assert Health.model_validate_json(payload).latency_ms["max"] == 25.0


def test_the_loop_pauses_after_messages_longer_after_few_and_not_behind_a_backlog() -> None:
    rig = Rig(StubEngine(), batch_limit=100)
    pauses: list[float] = []
    rig.clock.sleep = pauses.append
    for _ in range(350):
        rig.bus.deliver(received(record()))
    run(rig, 4)
    assert pauses == [0.0005] * 2, "one while 50 wait, one when none does"
    for _ in range(4):
        rig.bus.deliver(received(record()))
    run(rig, 1)
    assert pauses[2:] == [0.0015]


def test_a_turn_of_four_pauses_is_followed_by_a_quarter_of_one() -> None:
    rig = Rig(StubEngine())
    step, pauses = rig.engine.step, list[float]()

    def step_slowly(batch, now_us, clock_offset_us):
        FakeClock.sleep(rig.clock, 0.002)
        return step(batch, now_us, clock_offset_us)

    rig.engine.step = step_slowly
    rig.clock.sleep = pauses.append
    for _ in range(9):
        rig.bus.deliver(received(record()))
    run(rig, 1)
    assert pauses == [0.000125]


@pytest.mark.parametrize(
    ("vehicles", "wanted", "wait_s"), [(0, (), 0.25), (3, (), 0.02), (3, (Channel.STATE,), 1 / 64)]
)
def test_without_messages_it_waits_until_the_next_work(
    vehicles: int, wanted: tuple[Channel, ...], wait_s: float
) -> None:
    rig = Rig(StubEngine(), state_rate_hz=1.0)
    rig.bus.unwanted = {*Channel} - {*wanted}
    rig.engine.vehicles = vehicles
    waits: list[float] = []
    rig.bus.wait = waits.append
    run(rig, 1)
    assert waits == [pytest.approx(wait_s)]


def test_a_query_ends_the_wait_and_its_answer_is_not_waited_for() -> None:
    rig = Rig(StubEngine())
    rig.engine.vehicles = 0
    run(rig, 1)
    before_ns = rig.clock.monotonic_ns()
    rig.bus.queries.extend(MemoryQuery(KEYS.pairs) for _ in range(2))
    queries = list(rig.bus.queries)
    run(rig, 2 * 64 + 2)
    assert [len(query.answers) for query in queries] == [1, 1]
    assert rig.clock.monotonic_ns() - before_ns < 400_000_000, "of which the last wait, without work, is 250 ms"


def test_drain_judges_what_is_queued_and_tells_a_last_report() -> None:
    rig = Rig(StubEngine(), batch_limit=2)
    for _ in range(5):
        rig.bus.deliver(received(record()))
    assert rig.loop.drain(10.0) == 0
    assert not rig.bus.subscribed
    assert Health.model_validate_json(rig.bus.on(Channel.HEALTH)[-1][1]).scored == 5


def test_drain_gives_up_in_the_end() -> None:
    rig = Rig(StubEngine())
    rig.bus.delivered = False
    assert rig.loop.drain(0.5) == 0
    assert rig.clock.monotonic_ns() >= 500_000_000


def test_the_probes_follow_the_loop() -> None:
    rig = Rig(StubEngine())
    assert (rig.health.liveness_problem, rig.health.ready) == (None, False)
    rig.loop.iterate()
    assert rig.health.ready
    rig.bus.connected = False
    rig.loop.iterate()
    assert rig.health.readiness_problem == "not connected to the bus"
    rig.bus.connected = True
    rig.loop.iterate()
    rig.clock.sleep(2.5)
    assert rig.health.liveness_problem == "no loop iteration for 2.5 s"
    assert not rig.health.ready


def test_a_clock_that_leaps_moves_the_offset_and_no_duration() -> None:
    rig = Rig(StubEngine())
    start_us = rig.clock.local_us()
    rig.loop.iterate()
    rig.clock.leap(31 * 86_400_000_000)
    rig.bus.deliver(received(record()))
    rig.clock.sleep(0.1)
    rig.loop.iterate()
    assert rig.engine.now_us == [start_us, start_us + 100_000]
    assert rig.engine.clock_offset_us == 31 * 86_400_000_000


def test_an_onset_carries_the_messages_of_its_suspect_and_what_they_break() -> None:
    rig = Rig(StubEngine())
    sent = [received([record("other"), record("car1", msg_cnt=n, t_us=n)], "gw-1") for n in range(3)]
    for message in sent:
        rig.bus.deliver(message)
    rig.engine.events = [event(t_us=1, observations=("speed_change", "interval"))]
    rig.loop.iterate()
    published = Event.model_validate_json(rig.bus.on(Channel.ALERT)[0][1])
    assert published.observations == ("speed_change", "interval")
    assert [msgpack.unpackb(one.payload)[2] for one in published.evidence.messages] == [0, 1]
