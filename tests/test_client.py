import doctest
import threading
import time
from collections.abc import Callable, Iterator

import pytest
import zenoh
from fake_service import START_US, Service, Traffic, bus, event, free_port, health, service

from headway import client
from headway.client import BusFeed, SiteMessage, alerts, history
from headway.errors import UserError
from headway_schemas import Event, Health, PairState, Phase, RejectedCopy
from headway_schemas.query import EVENTS, AlertsQuery


@pytest.fixture
def endpoint() -> str:
    return f"tcp/127.0.0.1:{free_port()}"


@pytest.fixture
def feed(endpoint: str) -> Iterator[BusFeed]:
    client = BusFeed([endpoint], ["local"], buffer_limit=200)
    client.start()
    yield client
    client.close()


def until(done: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 20
    while not done():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def connect(running: Service, feed: BusFeed) -> None:
    """Wait until what the service tells arrives."""

    def arrives() -> bool:
        running.publish(health(1.0, START_US))
        return any(isinstance(received.message, Health) for received in feed.drain())

    until(arrives)
    list(feed.drain())


def deliver(feed: BusFeed, n: int) -> list[SiteMessage]:
    received: list[SiteMessage] = []

    def enough() -> bool:
        received.extend(h for h in feed.drain() if not isinstance(h.message, Health))
        return len(received) >= n

    until(enough)
    return received


def test_what_the_service_tells_arrives_as_it_was(endpoint: str, feed: BusFeed) -> None:
    states = list(Traffic(20).states(0.0, START_US))
    copy = RejectedCopy.of(
        reason="malformed", detail="not a map", key="v2x/local/bsm/a", sender="a", encoding="", payload=b"\xff",
        received_us=START_US, payload_max=10,
    )  # fmt: skip
    with service(endpoint) as running:
        connect(running, feed)
        running.publish(event(1), *states)
        running.session.put(running.keys.rejected("malformed"), copy.model_dump_json())
        received = deliver(feed, 22)
    assert {h.site for h in received} == {"local"}
    assert [h.message for h in received if isinstance(h.message, Event)] == [event(1)]
    assert [h.message for h in received if isinstance(h.message, PairState)] == states
    assert [h.message for h in received if isinstance(h.message, RejectedCopy)] == [copy]


def test_what_is_not_of_the_contract_is_counted(endpoint: str, feed: BusFeed) -> None:
    with service(endpoint) as running:
        connect(running, feed)
        key = running.keys.alert("bias", "a")
        running.session.put(key, b"{")
        running.session.put(key, event(1, site="elsewhere").model_dump_json())
        running.session.delete(key)
        running.publish(event(1))
        assert len(deliver(feed, 1)) == 1
    assert feed.connection.unreadable == 2


def test_an_inbox_keeps_the_newest_and_counts_the_rest(endpoint: str, feed: BusFeed) -> None:
    with service(endpoint) as running:
        connect(running, feed)
        for n in range(3):
            running.publish(*Traffic(100).states(0.0, START_US + n))
        until(lambda: feed.connection.dropped == 100)
        received = deliver(feed, 200)
    assert {h.message.t_us for h in received if isinstance(h.message, PairState)} == {START_US + 1, START_US + 2}


def test_the_link_comes_back_after_the_service(endpoint: str, feed: BusFeed) -> None:
    assert not feed.connection.connected
    for connections in (1, 2):
        with service(endpoint) as running:
            connect(running, feed)
            until(lambda: feed.connection.connected)
            assert feed.connection.connections == connections
        until(lambda: not feed.connection.connected)


def test_history_is_paged_without_a_gap(endpoint: str, feed: BusFeed) -> None:
    journal = [event(n, t_us=START_US + n // 3) for n in range(10)]
    published: list[Event] = []
    with service(endpoint, journal) as running:
        connect(running, feed)
        before_us = None
        while page := feed.history(["local"], AlertsQuery(limit=2, before_us=before_us)).events:
            published += page
            before_us = page[-1].detected_us
    assert len(published) == 10
    assert {e.event_id for e in published} == {e.event_id for e in journal}
    assert published[0].evidence is None


def test_two_journals_are_merged(endpoint: str, feed: BusFeed) -> None:
    first = [event(1), event(2, t_us=START_US + 2)]
    second = [event(1), event(3, t_us=START_US + 1)]
    with service(endpoint, first) as running, bus("client", connect=endpoint) as other:
        held = other.declare_queryable(running.keys.alerts, Service(other, running.keys, second).answer)
        connect(running, feed)
        until(lambda: feed.history(["local"], AlertsQuery()).answers == 2)
        found = feed.history(["local"], AlertsQuery(evidence=True))
        held.undeclare()
    assert [e.event_id for e in found.events] == ["veh-0002-2", "veh-0003-3", "veh-0001-1"]
    assert found.events[0].evidence is not None


def test_one_event_with_every_phase(endpoint: str, feed: BusFeed) -> None:
    journal = [event(1), event(2), event(1, Phase.CLEARED, t_us=START_US + 9)]
    with service(endpoint, journal) as running:
        connect(running, feed)
        found = feed.history(["local"], AlertsQuery(event="veh-0001-1")).events
    assert [e.phase for e in found] == [Phase.CLEARED, Phase.ONSET]


def test_a_refusal_and_nonsense_are_told_apart_from_nothing(endpoint: str, feed: BusFeed) -> None:
    def refuse(query: zenoh.Query) -> None:
        with query:
            query.reply_err(b"limit: too much")

    def babble(query: zenoh.Query) -> None:
        with query:
            query.reply("v2x/local/alerts", b"[1]")

    assert feed.history(["local"], AlertsQuery()).answers == 0
    for answer, problem in ((refuse, "limit: too much"), (babble, "1 validation error")):
        with service(endpoint) as running, bus("client", connect=endpoint) as other:
            held = other.declare_queryable(running.keys.alerts, answer)
            connect(running, feed)
            until(lambda: bool(feed.history(["local"], AlertsQuery()).problems))
            found = feed.history(["local"], AlertsQuery())
            held.undeclare()
        assert found.answers == 1
        assert problem in found.problems[0]


def test_the_reply_is_what_the_contract_reads() -> None:
    assert EVENTS.validate_json(EVENTS.dump_json([event(1)])) == [event(1)]


def test_every_endpoint_is_reached_and_one_that_is_late_is_waited_for() -> None:
    endpoints = [f"tcp/127.0.0.1:{free_port()}" for _ in range(2)]
    client = BusFeed(endpoints, ["east", "west"])
    client.start()

    def receives(running: Service, site: str) -> bool:
        running.publish(health(1.0, START_US, site=site))
        return any(received.site == site for received in client.drain())

    try:
        with service(endpoints[0], site="east") as east:
            until(lambda: receives(east, "east"))
            with service(endpoints[1], site="west") as west:
                until(lambda: receives(west, "west"))
                until(lambda: receives(east, "east"))
                assert client.connection.connections == 2
    finally:
        client.close()


@pytest.mark.parametrize("endpoint", ["nonsense", "tcp/"])
def test_a_malformed_endpoint_is_one_line_without_a_place_in_sources(endpoint: str) -> None:
    with pytest.raises(UserError) as refusal:
        BusFeed([endpoint], ["local"])
    assert str(refusal.value).startswith(f"{endpoint}: ")
    assert ".rs" not in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_alerts_are_an_iterator_of_events_that_ends_after_a_silence(endpoint: str) -> None:
    with service(endpoint) as running:
        received: list[Event] = []
        listener = threading.Thread(target=lambda: received.extend(alerts(endpoint, timeout_s=2.0)))
        listener.start()
        while not received and listener.is_alive():
            running.publish(health(1.0, START_US), event(1))
            listener.join(0.1)
        running.publish(event(2))
        listener.join()
    assert received[-1] == event(2)
    assert all(one == event(1) for one in received[:-1])


def test_what_a_gap_shows_to_be_missed_comes_from_the_history(endpoint: str) -> None:
    first, *missed, last = (event(n).model_copy(update={"instance": "rsu-1", "sequence": n}) for n in range(1, 6))
    with service(endpoint) as running:
        received: list[Event] = []
        listener = threading.Thread(target=lambda: received.extend(alerts(endpoint, timeout_s=2.0)))
        listener.start()
        while not received and listener.is_alive():
            running.publish(first)
            listener.join(0.1)
        running.journal += missed
        running.publish(last)
        listener.join()
    stored = [update.model_copy(update={"evidence": None}) for update in missed]
    assert received[received.count(first) :] == [*stored, last]


def test_history_holds_what_the_journals_answer() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with service(endpoint, [event(1), event(2, phase=Phase.CLEARED)]) as running:
        answered = history(connect=endpoint, site=["local"])
        assert len(history(AlertsQuery(phase=Phase.CLEARED), endpoint).events) == 1
        assert running.journal[0].evidence is not None
    assert {e.event_id for e in answered.events} == {"veh-0001-1", "veh-0002-2"}
    assert (answered.answers, answered.problems) == (1, ())


def test_a_site_that_is_no_chunk_of_a_key_is_refused() -> None:
    with pytest.raises(UserError):
        next(alerts(site="a/b"))


def test_the_examples_of_the_docstrings_are_right() -> None:
    assert doctest.testmod(client).failed == 0
