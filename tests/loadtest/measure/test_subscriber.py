import json

import pytest

from headway_loadtest.measure.subscriber import WAITING_MAX, Subscriber
from headway_schemas import Keys

KEYS = Keys("v2x", "crossing")


class FakeClock:
    now_ns = 0

    def monotonic_ns(self):
        return self.now_ns

    def sleep(self, _seconds):
        raise AssertionError


class FakePayload:
    def __init__(self, content):
        self.content = content

    def to_bytes(self):
        return self.content


class FakeSample:
    def __init__(self, content):
        self.payload = FakePayload(content)


class FakeSession:
    def __init__(self):
        self.callbacks = {}
        self.undeclared = 0

    def declare_subscriber(self, key, callback):
        self.callbacks[key] = callback
        return self

    def undeclare(self):
        self.undeclared += 1


def event(phase="onset", t_us=1000, kind="bias", **others):
    return {
        "event_id": "e1",
        "phase": phase,
        "kind": kind,
        "sensor": "speed",
        "suspect": "a",
        "follower": "a",
        "site": "crossing",
        "t_us": t_us,
        "detected_us": t_us,
        "model": "m",
        "config_hash": "h",
        **others,
    }


@pytest.fixture
def world():
    session, clock = FakeSession(), FakeClock()
    return session, clock, Subscriber(session, KEYS, clock)


def arrive(world, content, *, alert=True, at_ns=0):
    session, clock, _ = world
    clock.now_ns = at_ns
    text = content if isinstance(content, bytes) else json.dumps(content).encode()
    session.callbacks[KEYS.every_alert if alert else KEYS.every_health](FakeSample(text))


def test_the_life_of_an_event_is_one_episode(world):
    arrive(world, event("onset", 1000, "short"), at_ns=5)
    arrive(world, event("update", 3000, "noise"), at_ns=6)
    arrive(world, event("cleared", 4000, "bias"), at_ns=7)
    received = world[2].drain()
    (episode,) = received.episodes.values()
    assert (episode.received_ns, episode.onset_us, episode.last_us) == (5, 1000, 4000)
    assert (episode.kind, episode.cleared) == ("bias", True)
    assert received.alerts == 3


def test_health_comes_with_its_time(world):
    health = {"instance": "i", "scored": 3, "warming": 2, "rejected": {}, "lost": {}, "queue_depth": 0, "unheard_of": 1}
    arrive(world, health, alert=False, at_ns=9)
    (report,) = world[2].drain().health
    assert (report.received_ns, report.instance, report.counters.outcomes) == (9, "i", 5)


@pytest.mark.parametrize("content", [b"[]", b"{}", b"3", b'{"instance": "i"}', b"\xff"])
def test_health_that_is_none_is_counted(world, content):
    arrive(world, content, alert=False)
    received = world[2].drain()
    assert (received.unread, received.health) == (1, [])


def test_an_event_that_began_before_us_is_not_ours(world):
    arrive(world, event("update", 3000))
    received = world[2].drain()
    assert (received.alerts, received.episodes) == (1, {})


@pytest.mark.parametrize("content", [b"\xff", b"{}", json.dumps({"event_id": "e"}).encode()])
def test_what_cannot_be_read_is_counted(world, content):
    arrive(world, content)
    received = world[2].drain()
    assert (received.unread, received.alerts) == (1, 0)


def test_nothing_is_read_before_it_is_drained_and_nothing_piles_up(world):
    for _ in range(WAITING_MAX + 3):
        arrive(world, b"{}", alert=False)
    assert world[2].received.unread == 3
    assert world[2].received.health == []


def test_close_undeclares_both(world):
    world[2].close()
    assert world[0].undeclared == 2
