"""The bus over real zenoh on loopback: what senders put arrives stamped, what is told reaches who listens."""

import json
import signal
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
import zenoh
from edge.codec.messages import KEYS
from edge.transport.connections import connections
from sim.clock import FakeClock
from sim.loopback import free_endpoint, session
from sim.until import until

from headway.edge.clock import SystemClock
from headway.edge.fence import LEASE_EXPIRED, Fence
from headway.edge.transport.message import ReceivedMessage
from headway.edge.transport.ports import Channel
from headway.edge.transport.receive_queue import ReceiveQueue
from headway.edge.transport.zenoh_bus import ZenohBus
from headway.edge.transport.zenoh_config import BusConfig, BusError
from headway_schemas.encodings import BSM_MSGPACK, EVENT_JSON, PAIR_STATE_JSON

BLOCK = zenoh.CongestionControl.BLOCK


def config(**changes) -> BusConfig:
    fields = {
        "instance": "i",
        "mode": "peer",
        "connect": (),
        "listen": (free_endpoint(),),
        "options": None,
        "connect_timeout_s": 0.2,
        "block_timeout_s": 5.0,
        "alert_limit": 100,
        "payload_max_bytes": 1 << 16,
    }
    return BusConfig(**(fields | changes))


def go_on(seconds: float) -> bool:
    return not threading.Event().wait(min(seconds, 0.05))


def bus_of(settings: BusConfig) -> ZenohBus:
    return ZenohBus(settings, KEYS, SystemClock(), ReceiveQueue(10_000, 1 << 24, 10**12, len, 10**9))


@pytest.fixture
def settings() -> BusConfig:
    return config()


@pytest.fixture
def bus(settings: BusConfig) -> Iterator[ZenohBus]:
    bus = bus_of(settings)
    assert bus.open(go_on)
    yield bus
    bus.close()


@pytest.fixture
def other(bus: ZenohBus, settings: BusConfig) -> Iterator[zenoh.Session]:
    session_of_other = session("client", connect=settings.listen)
    until(lambda: bus.peers == 1)
    yield session_of_other
    session_of_other.close()


def drained(bus: ZenohBus, count: int) -> list[ReceivedMessage]:
    taken: list[ReceivedMessage] = []

    def enough() -> bool:
        taken.extend(bus.drain(10_000, 1 << 24, 0))
        return len(taken) >= count

    until(enough)
    return taken


def test_what_a_sender_puts_arrives_whole_and_stamped(bus: ZenohBus, other: zenoh.Session) -> None:
    clock = SystemClock()
    bus.drain(1, 1 << 24, 0)
    before_us, before_ns = clock.wall_us(), clock.monotonic_ns()
    bus.drain(1, 1 << 24, 0)
    other.put(KEYS.bsm("a"), b"\x01\x02", encoding=BSM_MSGPACK, congestion_control=BLOCK)
    [received] = drained(bus, 1)
    assert (received.key, received.payload, received.encoding, received.is_put) == (
        KEYS.bsm("a"), b"\x01\x02", BSM_MSGPACK, True,
    )  # fmt: skip
    assert before_us <= received.received_us <= clock.wall_us()
    assert before_ns <= received.received_ns <= clock.monotonic_ns()


def test_wildcards_and_deletes_are_passed_on_for_the_codec_to_name(bus: ZenohBus, other: zenoh.Session) -> None:
    other.put(f"{KEYS.prefix}/{KEYS.site}/bsm/*", b"x", congestion_control=BLOCK)
    other.delete(KEYS.bsm("a"), congestion_control=BLOCK)
    wild, deleted = drained(bus, 2)
    assert (wild.key[-1], wild.is_put) == ("*", True)
    assert (deleted.key, deleted.is_put) == (KEYS.bsm("a"), False)


def test_no_connection_lingers_when_it_is_closed(settings: BusConfig, bus: ZenohBus, other: zenoh.Session) -> None:
    assert not other.is_closed()
    until(lambda: connections(int(settings.listen[0].rpartition(":")[2])) == [False, False])


def test_none_of_many_messages_is_lost_and_each_is_counted(bus: ZenohBus, other: zenoh.Session) -> None:
    for n in range(5_000):
        other.put(KEYS.bsm("a"), n.to_bytes(4, "big"), congestion_control=BLOCK)
    assert [int.from_bytes(received.payload, "big") for received in drained(bus, 5_000)] == list(range(5_000))
    assert (bus.received, bus.waiting, bus.shed) == (5_000, 0, 0)


def test_a_wait_ends_with_the_first_message_and_all_that_follow_stay_in_order(
    bus: ZenohBus, other: zenoh.Session
) -> None:
    taken: list[ReceivedMessage] = []
    for n in range(200):
        other.put(KEYS.bsm("a"), n.to_bytes(4, "big"), congestion_control=BLOCK)
        if n % 7 == 0:
            bus.wait(0.001)
        taken += bus.drain(10_000, 1 << 24, 0)
    while len(taken) < 200:
        bus.wait(10.0)
        taken += bus.drain(10_000, 1 << 24, 0)
    assert [int.from_bytes(received.payload, "big") for received in taken] == list(range(200))


def test_a_message_after_a_wait_that_timed_out_is_received_and_stamped_on_arrival(
    bus: ZenohBus, other: zenoh.Session
) -> None:
    clock = SystemClock()
    bus.wait(0.01)
    assert bus.drain(10, 1 << 24, 0) == []
    before_ns = clock.monotonic_ns()
    other.put(KEYS.bsm("a"), b"x", congestion_control=BLOCK)
    taken: list[ReceivedMessage] = []
    while not taken:
        bus.wait(10.0)
        taken = bus.drain(10, 1 << 24, 0)
    assert before_ns <= taken[0].received_ns <= clock.monotonic_ns()


def test_a_signal_that_takes_longer_than_the_wait_does_not_prolong_it(bus: ZenohBus) -> None:
    before = signal.signal(signal.SIGALRM, lambda *_: time.sleep(0.05))
    signal.setitimer(signal.ITIMER_REAL, 0.005)
    try:
        bus.wait(0.02)
    finally:
        signal.signal(signal.SIGALRM, before)


def test_a_query_ends_a_wait(bus: ZenohBus, other: zenoh.Session) -> None:
    answers = other.get(KEYS.pairs)
    while (query := bus.next_query()) is None:
        bus.wait(10.0)
    query.answer(b"[]", EVENT_JSON)
    assert [bytes(answer.ok.payload) for answer in answers] == [b"[]"]


def test_after_the_unsubscription_a_wait_ends_and_all_is_delivered(bus: ZenohBus, other: zenoh.Session) -> None:
    bus.wait(0.001)
    other.put(KEYS.bsm("a"), b"x", congestion_control=BLOCK)
    taken: list[ReceivedMessage] = []
    while not taken:
        bus.wait(10.0)
        taken = bus.drain(10, 1 << 24, 0)
    bus.wait(0.001)
    bus.unsubscribe()
    while not bus.delivered:
        bus.wait(10.0)
        bus.drain(10, 1 << 24, 0)


def test_an_alert_reaches_its_subscribers_with_its_encoding(bus: ZenohBus, other: zenoh.Session) -> None:
    got: list[zenoh.Sample] = []
    other.declare_subscriber(KEYS.every_alert, got.append)

    def published() -> bool:
        bus.publish(Channel.ALERT, KEYS.alert("bias", "a"), b"{}")
        return bool(got)

    until(published)
    assert (str(got[0].key_expr), str(got[0].encoding)) == (KEYS.alert("bias", "a"), EVENT_JSON)
    assert got[0].priority == zenoh.Priority.INTERACTIVE_HIGH
    assert got[0].congestion_control == BLOCK


def test_a_router_need_not_wait_for_a_subscriber_of_alerts_that_takes_none() -> None:
    endpoint, got = free_endpoint(), []
    router = session("router", listen=(endpoint,))
    settings = config(mode=None, connect=None, listen=None, options=f"""{{
        mode: "client", connect: {{ endpoints: ["{endpoint}"] }},
        scouting: {{ multicast: {{ enabled: false }}, gossip: {{ enabled: false }} }},
    }}""", block_timeout_s=0.5)  # fmt: skip
    waits = json.loads(settings.zenoh_config().get_json("transport/link/tx/queue/congestion_control/drop"))
    assert set(waits.values()) == {500_000}
    bus, other = bus_of(settings), session("client", connect=(endpoint,))
    bus.open(go_on)
    other.declare_subscriber(KEYS.every_alert, got.append)
    until(lambda: bus.publish(Channel.ALERT, KEYS.alert("bias", "a"), b"{}") or got)
    assert got[0].congestion_control == zenoh.CongestionControl.DROP
    bus.close()
    other.close()
    router.close()


def test_another_service_of_the_site_is_known_by_its_health(bus: ZenohBus, settings: BusConfig) -> None:
    second = bus_of(config(mode="client", connect=settings.listen, listen=()))
    assert second.open(go_on)

    def known() -> bool:
        bus.publish(Channel.HEALTH, KEYS.health("i"), b"{}")
        second.publish(Channel.HEALTH, KEYS.health("second"), b"{}")
        return bool(bus.other_services and second.other_services)

    until(known)
    assert (bus.other_services, second.other_services) == (("second",), ("i",))
    second.close()


def test_a_channel_is_wanted_while_somebody_listens(bus: ZenohBus, other: zenoh.Session) -> None:
    assert not bus.wanted(Channel.STATE)
    subscriber = other.declare_subscriber(KEYS.pair_state("a"), lambda _: None)
    until(lambda: bus.wanted(Channel.STATE))
    assert not bus.wanted(Channel.REJECTED)
    subscriber.undeclare()
    until(lambda: not bus.wanted(Channel.STATE))
    assert bus.wanted(Channel.ALERT)


def test_a_question_is_kept_until_the_loop_answers_it(bus: ZenohBus, other: zenoh.Session) -> None:
    replies = other.get(f"{KEYS.pairs}?site=s;kind=bias", timeout=20.0)
    asked = []
    until(lambda: asked.append(bus.next_query()) or asked[-1])
    assert (asked[-1].key, asked[-1].parameters) == (KEYS.pairs, {"site": "s", "kind": "bias"})
    asked[-1].answer(b"[]", PAIR_STATE_JSON)
    [reply] = list(replies)
    assert (reply.ok.payload.to_bytes(), str(reply.ok.encoding)) == (b"[]", PAIR_STATE_JSON)


def test_a_stalled_subscriber_holds_up_neither_who_publishes_nor_the_end_and_is_cut_off() -> None:
    settings = config(block_timeout_s=0.5, alert_limit=10_000)
    bus = bus_of(settings)
    assert bus.open(go_on)
    stalled = session("client", connect=settings.listen)
    until(lambda: bus.peers == 1)
    go, called = threading.Event(), threading.Event()

    def stall(_sample: zenoh.Sample) -> None:
        called.set()
        go.wait(60.0)

    stalled.declare_subscriber(KEYS.every_alert, stall)
    payload = bytes(100_000)
    until(lambda: bus.publish(Channel.ALERT, KEYS.alert("bias", "a"), payload) or called.is_set())
    for _ in range(2_000):
        bus.publish(Channel.ALERT, KEYS.alert("bias", "a"), payload)
    until(lambda: bus.peers == 0)
    bus.close()
    assert bus.dropped["alert_queue_full"] == 0
    go.set()
    stalled.close()


def test_the_instance_is_alive_until_it_signs_off(settings: BusConfig) -> None:
    bus = bus_of(settings)
    assert not bus.connected
    bus.open(go_on)
    watcher = session("client", connect=settings.listen)
    seen: list[tuple[str, bool]] = []
    watcher.liveliness().declare_subscriber(
        KEYS.every_liveliness,
        lambda sample: seen.append((str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)),
        history=True,
    )
    until(lambda: seen == [(KEYS.liveliness("i"), True)])
    bus.close()
    until(lambda: seen[1:] == [(KEYS.liveliness("i"), False)])
    watcher.close()


def test_what_is_under_way_is_delivered_after_unsubscribing(bus: ZenohBus, other: zenoh.Session) -> None:
    for _ in range(500):
        other.put(KEYS.bsm("a"), b"x", congestion_control=BLOCK)
    drained(bus, 1)
    assert bus.subscribed
    bus.unsubscribe()
    assert not bus.subscribed
    assert not bus.delivered
    until(lambda: bus.drain(10_000, 1 << 24, 0) is None or bus.delivered)
    received = bus.received
    other.put(KEYS.bsm("a"), b"x", congestion_control=BLOCK)
    assert (bus.drain(10_000, 1 << 24, 0), bus.received) == ([], received)


def test_a_client_waits_for_its_router_and_notices_when_it_goes() -> None:
    endpoint = free_endpoint()
    bus = bus_of(config(mode="client", connect=(endpoint,), listen=()))
    routers: list[zenoh.Session] = []

    def router_comes_late(_seconds: float) -> bool:
        routers.append(session("router", listen=(endpoint,)))
        return True

    assert bus.open(router_comes_late)
    until(lambda: bus.connected)
    routers.pop().close()
    until(lambda: not bus.connected)
    routers.append(session("router", listen=(endpoint,)))
    until(lambda: bus.connected)
    bus.close()
    routers.pop().close()


def test_a_client_gives_up_when_told_to() -> None:
    bus = bus_of(config(mode="client", connect=(free_endpoint(),), listen=()))
    assert not bus.open(lambda _: False)
    bus.close()


def test_an_address_that_is_taken_is_an_error_in_one_line(bus: ZenohBus, settings: BusConfig) -> None:
    second = bus_of(settings)
    with pytest.raises(BusError) as caught:
        second.open(go_on)
    assert "\n" not in str(caught.value)
    second.close()


def test_options_of_zenoh_decide_what_the_settings_leave_to_them() -> None:
    endpoint = free_endpoint()
    options = (
        f'{{ mode: "peer", listen: {{ endpoints: ["{endpoint}"] }}, scouting: {{ multicast: {{ enabled: false }} }} }}'
    )
    settings = config(mode=None, connect=None, listen=None, options=options)
    bus = bus_of(settings)
    bus.open(go_on)
    session("client", connect=(endpoint,)).close()
    bus.close()
    with pytest.raises(BusError, match="zenoh options"):
        bus_of(replace(settings, options="{ moed: 1 }"))


def test_a_bus_without_the_right_to_publish_puts_nothing(settings: BusConfig, tmp_path: Path) -> None:
    clock, reasons, received = FakeClock(), [], []
    fence = Fence(tmp_path / "site.epoch", 1, 8.0, clock, lambda: None, reasons.append)
    fence.claim()
    bus = ZenohBus(settings, KEYS, SystemClock(), ReceiveQueue(100, 1 << 24, 10**12, len, 10**9), fence)
    assert bus.open(go_on)
    subscriber = session("client", connect=settings.listen)
    subscriber.declare_subscriber(KEYS.every_alert, lambda sample: received.append(sample.payload.to_bytes()))

    def publish(payload: bytes) -> list[bytes]:
        bus.publish(Channel.ALERT, KEYS.alert("bias", "a"), payload)
        return received

    until(lambda: publish(b"within the lease"))
    clock.sleep(8.001)
    publish(b"after it")
    bus.close()
    fence.release()
    subscriber.close()
    assert set(received) == {b"within the lease"}
    assert set(reasons) == {LEASE_EXPIRED}
