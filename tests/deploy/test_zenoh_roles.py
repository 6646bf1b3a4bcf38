"""The roles of the router over TLS, as a matrix: what each may put, subscribe to and ask."""

import pytest
import zenoh
from deploy.test_zenoh_access import BLOCK, KEYS, Members, address, bus, tls  # noqa: F401 - fixtures
from sim.until import until

SENDER, SERVICE, DASHBOARD, UNKNOWN = "gw-north", "headway-local", "dashboard", "unknown"
ROLES = (SENDER, SERVICE, DASHBOARD, UNKNOWN)

PUT = {
    KEYS.bsm(SENDER): SENDER,
    KEYS.bsm("gw-south"): None,
    "v2x/local/bsm/*": None,
    KEYS.alert("bias", "a"): SERVICE,
    KEYS.pair_state("a"): SERVICE,
    KEYS.quality("a"): SERVICE,
    KEYS.rejected("malformed"): SERVICE,
    KEYS.handled("a"): SERVICE,
    KEYS.health(SERVICE): SERVICE,
    KEYS.health("another"): None,
}
"""Who may put to each key."""

SUBSCRIBE = {
    KEYS.every_bsm: (KEYS.bsm(SENDER), {SERVICE}),
    KEYS.every_alert: (KEYS.alert("bias", "a"), {DASHBOARD}),
    KEYS.every_pair_state: (KEYS.pair_state("a"), {DASHBOARD}),
    KEYS.every_quality: (KEYS.quality("a"), {DASHBOARD}),
    KEYS.every_rejected: (KEYS.rejected("malformed"), {DASHBOARD}),
    KEYS.every_handled: (KEYS.handled("a"), {DASHBOARD}),
    KEYS.every_health: (KEYS.health(SERVICE), {DASHBOARD, SERVICE}),
}
"""A key that matches each expression, and who may subscribe to it."""


@pytest.fixture
def received(bus: Members) -> list[tuple[str, str, bytes]]:  # noqa: F811
    """What each role receives of everything it subscribes to: role, key, payload."""
    received: list[tuple[str, str, bytes]] = []

    def note(role: str):
        return lambda sample: received.append((role, str(sample.key_expr), sample.payload.to_bytes()))

    for role in ROLES:
        session = bus.session(role)
        for expression in SUBSCRIBE:
            session.declare_subscriber(expression, note(role))
    return received


def settled(bus: Members, received: list) -> None:  # noqa: F811
    """Wait until what was put before has come as far as it goes: a message of each publisher follows it."""
    fences = {SENDER: (KEYS.bsm(SENDER), SERVICE), SERVICE: (KEYS.health(SERVICE), DASHBOARD)}
    sessions = {role: bus.session(role) for role in fences}

    def through() -> bool:
        for role, (key, _) in fences.items():
            sessions[role].put(key, b"fence", congestion_control=BLOCK)
        return all((reader, key, b"fence") in received for key, reader in fences.values())

    until(through)


@pytest.mark.parametrize("action", ["put", "delete"])
def test_who_may_put(bus: Members, received: list, action: str) -> None:  # noqa: F811
    settled(bus, received)
    for role in ROLES:
        session = bus.session(role)
        for key in PUT:
            if action == "put":
                session.put(key, role.encode(), congestion_control=BLOCK)
            else:
                session.delete(key, congestion_control=BLOCK)
    wanted = {(key, role.encode()) for key, role in PUT.items() if role} if action == "put" else set()
    until(lambda: wanted <= {(key, payload) for _, key, payload in received})
    settled(bus, received)
    assert {(key, payload) for _, key, payload in received if payload != b"fence"} == wanted


def test_who_may_subscribe(bus: Members, received: list) -> None:  # noqa: F811
    settled(bus, received)
    for key, _ in SUBSCRIBE.values():
        bus.session(SENDER if key == KEYS.bsm(SENDER) else SERVICE).put(key, b"real", congestion_control=BLOCK)
    wanted = {(role, key) for key, roles in SUBSCRIBE.values() for role in roles}
    until(lambda: wanted <= {(role, key) for role, key, payload in received if payload == b"real"})
    settled(bus, received)
    assert {(role, key) for role, key, _ in received} == wanted


@pytest.mark.parametrize("key", [KEYS.alerts, KEYS.pairs, KEYS.handling])
def test_who_may_ask(bus: Members, key: str) -> None:  # noqa: F811
    def answer(query: zenoh.Query) -> None:
        query.reply(key, b"[]")
        query.drop()

    bus.session(SERVICE).declare_queryable(key, answer)
    until(lambda: any(reply.ok for reply in bus.session(DASHBOARD).get(key, timeout=1.0)))
    for role in (SENDER, UNKNOWN):
        assert [reply for reply in bus.session(role).get(key, timeout=0.5) if reply.ok] == []


@pytest.mark.parametrize("role", [SENDER, DASHBOARD, UNKNOWN])
def test_who_may_answer(bus: Members, role: str) -> None:  # noqa: F811
    def forge(query: zenoh.Query) -> None:
        query.reply(KEYS.alerts, b"forged")
        query.drop()

    def answer(query: zenoh.Query) -> None:
        query.reply(KEYS.alerts, b"[]")
        query.drop()

    bus.session(role).declare_queryable(KEYS.alerts, forge)
    bus.session(SERVICE).declare_queryable(KEYS.alerts, answer)
    asking, answers = bus.session(DASHBOARD), []
    until(
        lambda: answers.extend(r.ok.payload.to_bytes() for r in asking.get(KEYS.alerts, timeout=1.0) if r.ok) or answers
    )
    assert set(answers) == {b"[]"}
