"""The router's configuration at work: who gets in, and what arrives of what is said."""

import importlib.util
import json
import socket
import tomllib
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from itertools import count
from pathlib import Path
from types import ModuleType

import pytest
import zenoh
from deploy.pki import Authority
from sim.until import until

from headway.client import BusFeed
from headway.edge.clock import SystemClock
from headway.edge.transport.ports import Channel
from headway.edge.transport.receive_queue import ReceiveQueue
from headway.edge.transport.zenoh_bus import ZenohBus
from headway.edge.transport.zenoh_config import BusConfig
from headway.settings import Settings
from headway_schemas import RejectedCopy
from headway_schemas.keys import Keys
from headway_schemas.query import AlertsQuery

FOLDER = Path(__file__).resolve().parents[2] / "deploy" / "zenoh"
KEYS = Keys("v2x", "local")
BLOCK = zenoh.CongestionControl.BLOCK


def access() -> ModuleType:
    spec = importlib.util.spec_from_file_location("access", FOLDER / "access.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def members() -> dict:
    return tomllib.loads((FOLDER / "members.toml").read_text())


@pytest.fixture(scope="module")
def tls(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tls")
    ours = Authority(folder)
    for name in ("router", "gw-north", "headway-local", "dashboard", "unknown"):
        ours.issue(name)
    ours.issue("gw-north", file="expired", days=-1)
    foreign = Authority(folder, "foreign")
    foreign.issue("impostor")
    return folder


def free_address() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"127.0.0.1:{probe.getsockname()[1]}"


@contextmanager
def router(template: str, tls: Path) -> Iterator[str]:
    """Run a router of the template; yields where it listens, `127.0.0.1:<port>`."""
    address = free_address()
    (tls / "passwords").write_text("gw-north:north\nheadway-local:local\n")
    options = access().fill((FOLDER / template).read_text(), members())
    for place, here in (("[::]:7447", address), ("/etc/zenoh/tls", str(tls)), ("/etc/zenoh", str(tls))):
        options = options.replace(place, here)
    session = zenoh.open(zenoh.Config.from_json5(options))
    yield address
    session.close()


@pytest.fixture(scope="module")
def address(tls: Path) -> Iterator[str]:
    with router("router.tls.json5", tls) as address:
        yield address


def client_options(tls: Path, address: str, name: str) -> str:
    options = (FOLDER / "client.json5").read_text()
    for place, here in (
        ("router.example:7447", address),
        ("/etc/headway/tls/headway", str(tls / name)),
        ("/etc/headway/tls", str(tls)),
    ):
        assert place in options
        options = options.replace(place, here)
    return options


def client_config(tls: Path, address: str, name: str, **changes: object) -> zenoh.Config:
    config = zenoh.Config.from_json5(client_options(tls, address, name))
    config.insert_json5("connect/timeout_ms", "500")
    for key, value in changes.items():
        config.insert_json5(key.replace("__", "/"), json.dumps(value))
    return config


class Members:
    """Members of the bus, opened as they are asked for."""

    def __init__(self, tls: Path, address: str) -> None:
        self._tls = tls
        self._address = address
        self.stack = ExitStack()

    def session(self, name: str) -> zenoh.Session:
        session = zenoh.open(client_config(self._tls, self._address, name))
        self.stack.callback(session.close)
        return session

    def service(self) -> ZenohBus:
        config = BusConfig(
            instance="headway-local",
            mode=None,
            connect=None,
            listen=None,
            options=client_options(self._tls, self._address, "headway-local"),
            connect_timeout_s=2.0,
            block_timeout_s=10.0,
            alert_limit=100,
            payload_max_bytes=1 << 16,
        )
        bus = ZenohBus(config, KEYS, SystemClock(), ReceiveQueue(1_000, 1 << 24, 10**12, len, 10**9))
        assert bus.open(lambda _: False)
        self.stack.callback(bus.close)
        return bus

    def dashboard(self) -> BusFeed:
        file = self._tls / "dashboard.json5"
        file.write_text(client_options(self._tls, self._address, "dashboard"))
        feed = BusFeed((), ("local",), zenoh_config=file)
        feed.start()
        self.stack.callback(feed.close)
        until(lambda: feed.connection.connected)
        return feed


@pytest.fixture
def bus(tls: Path, address: str) -> Iterator[Members]:
    members = Members(tls, address)
    with members.stack:
        yield members


def said(service: ZenohBus) -> list[tuple[str, bytes]]:
    return [(received.key, received.payload) for received in service.drain(1_000, 1 << 24, 0)]


FENCES = count()


def received_after(service: ZenohBus, sender: zenoh.Session) -> list[tuple[str, bytes]]:
    """Return what arrived before a message of the sender's own, which arrives for certain."""
    own = KEYS.bsm("gw-north")
    arrived: list[tuple[str, bytes]] = []
    fence = b"fence %d" % next(FENCES)  # a late one of an earlier call must not pass for this one's

    def through() -> bool:
        sender.put(own, fence, congestion_control=BLOCK)
        arrived.extend(said(service))
        return (own, fence) in arrived

    until(through)
    return [message for message in arrived if not message[1].startswith(b"fence")]


def test_a_sender_is_heard_under_its_own_name(bus: Members) -> None:
    service, sender = bus.service(), bus.session("gw-north")
    received_after(service, sender)
    sender.put(KEYS.bsm("gw-north"), b"put", congestion_control=BLOCK)
    sender.declare_publisher(KEYS.bsm("gw-north")).put(b"published")
    assert received_after(service, sender) == [(KEYS.bsm("gw-north"), b"put"), (KEYS.bsm("gw-north"), b"published")]


@pytest.mark.parametrize(
    "key",
    [
        "v2x/local/bsm/gw-south",
        "v2x/local/bsm/*",
        "v2x/*/bsm/gw-north",
        "v2x/local/bsm/gw-north/below",
        "v2x/other/bsm/gw-north",
    ],
)
def test_a_sender_is_not_heard_under_any_other(bus: Members, key: str) -> None:
    service, sender = bus.service(), bus.session("gw-north")
    received_after(service, sender)
    sender.put(key, b"forged", congestion_control=BLOCK)
    assert received_after(service, sender) == []


def test_a_delete_and_an_oversized_payload_go_no_further(bus: Members) -> None:
    service, sender = bus.service(), bus.session("gw-north")
    received_after(service, sender)
    sender.delete(KEYS.bsm("gw-north"), congestion_control=BLOCK)
    sender.put(KEYS.bsm("gw-north"), bytes(Settings().payload_bytes_limit + 1), congestion_control=BLOCK)
    assert received_after(service, sender) == []
    sender.put(KEYS.bsm("gw-north"), bytes(Settings().payload_bytes_limit), congestion_control=BLOCK)
    assert len(received_after(service, sender)) == 1


def test_only_the_service_tells_and_the_dashboard_hears_all_of_it(bus: Members) -> None:
    service, sender, watcher = bus.service(), bus.session("gw-north"), bus.session("dashboard")
    received: list[str] = []
    for key in (KEYS.every_alert, KEYS.every_pair_state, KEYS.every_quality, KEYS.every_rejected, KEYS.every_health):
        watcher.declare_subscriber(key, lambda sample: received.append(str(sample.key_expr)))
    until(lambda: all(map(service.wanted, (Channel.STATE, Channel.QUALITY, Channel.REJECTED))))
    sent = {
        Channel.ALERT: KEYS.alert("bias", "a"),
        Channel.STATE: KEYS.pair_state("a"),
        Channel.QUALITY: KEYS.quality("a"),
        Channel.REJECTED: KEYS.rejected("malformed"),
        Channel.HEALTH: KEYS.health("headway-local"),
    }
    for forger in (sender, bus.session("dashboard")):
        for key in sent.values():
            forger.put(key, b"forged", congestion_control=BLOCK)
    received_after(service, sender)
    for channel, key in sent.items():
        service.publish(channel, key, b"{}")
    until(lambda: len(received) >= len(sent))
    assert sorted(received) == sorted(sent.values())


def test_what_vehicles_send_is_for_the_service_alone(bus: Members) -> None:
    service, sender = bus.service(), bus.session("gw-north")
    spies = [bus.session("dashboard"), bus.session("unknown")]
    spied: list[str] = []
    for spy in spies:
        for key in (KEYS.every_bsm, "**"):
            spy.declare_subscriber(key, lambda sample: spied.append(str(sample.key_expr)))
    received_after(service, sender)
    service.publish(Channel.HEALTH, KEYS.health("headway-local"), b"{}")
    received_after(service, sender)
    assert spied == []


def test_the_dashboard_asks_and_sees_who_lives_and_others_do_not(bus: Members) -> None:
    service, sender, watcher = bus.service(), bus.session("gw-north"), bus.session("dashboard")
    alive: list[tuple[str, bool]] = []
    watcher.liveliness().declare_subscriber(
        KEYS.every_liveliness,
        lambda sample: alive.append((str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)),
        history=True,
    )
    until(lambda: alive == [(KEYS.liveliness("headway-local"), True)])
    asked: list[object] = []

    def answered() -> bool:
        query = service.next_query()
        if query is not None:
            query.answer(b"[]", "application/json")
            asked.append(query)
        return bool(asked)

    assert list(sender.get(KEYS.pairs, timeout=0.5)) == []
    assert not answered()
    replies = watcher.get(KEYS.pairs, timeout=20.0)
    until(answered)
    assert [reply.ok.payload.to_bytes() for reply in replies if reply.ok] == [b"[]"]


def test_a_refusal_reaches_who_asked(bus: Members) -> None:
    service, watcher = bus.service(), bus.session("dashboard")

    def refused() -> bool:
        query = service.next_query()
        if query is not None:
            query.refuse("not today")
        return query is not None

    replies = watcher.get(KEYS.pairs, timeout=20.0)
    until(refused)
    assert [reply.err.payload.to_string() for reply in replies if reply.err] == ["not today"]


def test_the_bundled_dashboard_is_content_with_its_rules(bus: Members) -> None:
    service, feed = bus.service(), bus.dashboard()
    copy = RejectedCopy(
        reason="malformed", detail="d", key="k", encoding="e", size=0, payload=b"", truncated=False, received_us=1
    )
    until(lambda: service.wanted(Channel.REJECTED))
    service.publish(Channel.REJECTED, KEYS.rejected("malformed"), copy.model_dump_json().encode())
    received: list[object] = []
    until(lambda: received.extend(feed.drain()) or received)
    assert feed.history(("local",), AlertsQuery()).problems == ()


def certificate(file: str) -> dict:
    return {
        "transport__link__tls": {
            "root_ca_certificate": "{tls}/ca.crt",
            "connect_private_key": f"{{tls}}/{file}.key",
            "connect_certificate": f"{{tls}}/{file}.crt",
            "enable_mtls": True,
        }
    }


@pytest.mark.parametrize(
    "changes",
    [
        {"connect__endpoints": ["tcp/{address}"], "transport__link__protocols": ["tcp"]},
        {"transport__link__tls": {"root_ca_certificate": "{tls}/ca.crt"}},
        certificate("impostor"),
        certificate("expired"),
        {"transport__link__tls__root_ca_certificate": "{tls}/foreign.crt"},
    ],
    ids=[
        "plain tcp",
        "no certificate",
        "a certificate of another authority",
        "an expired one",
        "the router is not the one meant",
    ],
)
def test_who_is_not_known_is_refused(tls: Path, address: str, changes: dict) -> None:
    here = json.loads(json.dumps(changes).replace("{address}", address).replace("{tls}", str(tls)))
    config = client_config(tls, address, "gw-north", **here)
    with pytest.raises(zenoh.ZError):
        zenoh.open(config)


def test_passwords_over_tls_do_the_same(tls: Path) -> None:
    with router("router.password.json5", tls) as address, ExitStack() as stack:

        def session(user: str, password: str) -> zenoh.Session:
            credentials = {"user": user, "password": password}
            trust = {"root_ca_certificate": str(tls / "ca.crt")}
            config = client_config(tls, address, "x", transport__link__tls=trust, transport__auth__usrpwd=credentials)
            session = zenoh.open(config)
            stack.callback(session.close)
            return session

        for user, password in (("gw-north", "wrong"), ("nobody", "north")):
            with pytest.raises(zenoh.ZError):
                session(user, password)
        service, sender = session("headway-local", "local"), session("gw-north", "north")
        received: list[str] = []
        service.declare_subscriber(KEYS.every_bsm, lambda sample: received.append(str(sample.key_expr)))

        def through() -> bool:
            sender.put(KEYS.bsm("gw-south"), b"", congestion_control=BLOCK)
            sender.put(KEYS.bsm("gw-north"), b"", congestion_control=BLOCK)
            return bool(received)

        until(through)
        assert set(received) == {KEYS.bsm("gw-north")}


def test_the_router_for_trying_out_passes_messages_on() -> None:
    address = free_address()
    options = (FOLDER / "trial.json5").read_text().replace("[::]:7447", address)
    config = zenoh.Config()
    for key, value in (("mode", "client"), ("connect/endpoints", [f"tcp/{address}"])):
        config.insert_json5(key, json.dumps(value))
    received: list[str] = []
    with zenoh.open(zenoh.Config.from_json5(options)), zenoh.open(config) as one, zenoh.open(config) as other:
        one.declare_subscriber(KEYS.every_bsm, lambda sample: received.append(str(sample.key_expr)))
        until(lambda: other.put(KEYS.bsm("a"), b"") or received)
    assert set(received) == {KEYS.bsm("a")}


def test_the_two_templates_differ_in_how_a_member_is_known_only() -> None:
    def effective(template: str) -> dict:
        config = zenoh.Config.from_json5(access().fill((FOLDER / template).read_text(), members()))
        return {
            section: json.loads(config.get_json(section))
            for section in ("mode", "listen", "scouting", "adminspace", "low_pass_filter", "qos", "transport")
        }

    by_certificate, by_password = effective("router.tls.json5"), effective("router.password.json5")
    by_password["transport"]["auth"]["usrpwd"]["dictionary_file"] = None
    by_password["transport"]["link"]["tls"]["enable_mtls"] = True
    assert by_certificate == by_password


@pytest.mark.parametrize("template", ["router.tls.json5", "router.password.json5"])
def test_zenoh_refuses_a_template_without_rules(template: str) -> None:
    with pytest.raises(zenoh.ZError):
        zenoh.Config.from_json5((FOLDER / template).read_text())


def test_the_router_lets_through_what_the_service_reads() -> None:
    for template in FOLDER.glob("router.*.json5"):
        config = zenoh.Config.from_json5(access().fill(template.read_text(), members()))
        [limit] = json.loads(config.get_json("low_pass_filter"))
        assert limit["size_limit"] == Settings().payload_bytes_limit


@pytest.mark.parametrize("spoilt", [{"guests": ["a"]}, {"senders": ["gw/../*"]}, {"senders": ["*"]}])
def test_an_unknown_role_or_an_unfit_name_is_refused(spoilt: dict) -> None:
    with pytest.raises(ValueError, match=r"a role is|a name is"):
        access().access_control({"prefix": "v2x", "sites": {"local": spoilt}}, "usernames")
