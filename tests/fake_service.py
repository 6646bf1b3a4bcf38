"""A stand-in for the service: what it would tell of some vehicles on a road, to those who listen."""

import math
import socket
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

import zenoh

from headway.client import Connection, History, Message, SiteMessage
from headway_schemas import Event, Evidence, Health, Innovation, Keys, Kind, PairState, Phase, Recovered, Sensor
from headway_schemas.event import Deviation, Stage
from headway_schemas.handling import HANDLINGS, Handling, HandlingRequest
from headway_schemas.query import EVENTS, AlertsQuery
from headway_schemas.state import Standing

COLUMNS = (
    "t_s", "x_m", "v_mps", "leader_t_s", "leader_x_m", "leader_v_mps", "leader_length_m", "range_m", "range_rate_mps",
)  # fmt: skip
Reading = tuple[float, ...]
START_US = 1_700_000_000_000_000
GATE = 13.8


def event(
    n: int = 1,
    phase: Phase = Phase.ONSET,
    *,
    kind: Kind = Kind.BIAS,
    sensor: Sensor = Sensor.SPEED,
    t_us: int = START_US,
    onset_us: int | None = None,
    site: str = "local",
    suspect: str | None = None,
) -> Event:
    """Return a statement about event `n`: readings that are off since its onset (a miss has none)."""
    vehicle = suspect or f"veh-{n:04d}"
    off_x_m = 9.0 if sensor in {Sensor.LOCATION, Sensor.BOTH} else 0.0
    off_v_mps = 4.0 if sensor in {Sensor.SPEED, Sensor.BOTH} else 0.0
    received, over = kind is not Kind.MISS, phase is not Phase.CLEARED
    wrong_s = ((onset_us or t_us) / 1e6 - 0.05, t_us / 1e6 - (0 if over else 1.0) + 0.05)
    readings = tuple(_readings(t_us / 1e6, wrong_s, off_x_m, off_v_mps)) if received else ()
    deviation = Deviation(x_m=off_x_m, v_mps=off_v_mps) if received and sensor is not Sensor.LINK else None
    if not over:
        off_x_m = off_v_mps = 0.0
    statistic = 61.0 + 7.0 * math.sin(n) if over else 2.1
    return Event(
        event_id=f"{vehicle}-{n}",
        phase=phase,
        kind=kind,
        sensor=sensor,
        suspect=vehicle,
        leader=f"veh-{n + 1:04d}",
        follower=vehicle,
        site=site,
        t_us=t_us,
        detected_us=t_us + 2_300,
        nis=statistic,
        statistic=statistic,
        gate=GATE,
        p_value=math.exp(-statistic / 2),
        innovation=Innovation(x_m=off_x_m + 0.2, v_mps=off_v_mps - 0.1) if received else None,
        recovered=Recovered(
            x_m=readings[-1][1] - off_x_m, v_mps=readings[-1][2] - off_v_mps, x_std_m=0.8, v_std_mps=0.35
        )
        if received
        else None,
        deviation=deviation,
        latency_us={Stage.WIRE: 1_100, Stage.QUEUE: 340, Stage.DECODE: 120, Stage.DETECT: 740},
        model="headway",
        config_hash="7f3a91c2",
        confidence=0.93,
        evidence=Evidence(columns=COLUMNS, readings=readings, checkpoint=b"\0" * 64) if received else None,
    )


def _readings(until_s: float, wrong_s: tuple[float, float], off_x_m: float, off_v_mps: float) -> Iterator[Reading]:
    for i in range(40):
        t_s = until_s + (i - 39) / 10
        s = t_s % 1_000
        wrong = wrong_s[0] < t_s < wrong_s[1]
        v_mps = 26.0 + 1.5 * math.sin((s - 1.5) / 3)
        x_m = 26.0 * s - 4.5 * math.cos((s - 1.5) / 3)
        leader_v_mps = 26.0 + 1.5 * math.sin(s / 3)
        gap_m = 31.0 - 4.5 * (math.cos(s / 3) - math.cos((s - 1.5) / 3))
        noise = 0.08 * math.sin(37.0 * i)
        yield (
            t_s, x_m + noise + wrong * off_x_m, v_mps + noise + wrong * off_v_mps,
            t_s - 0.04, x_m + gap_m + 4.6 - 0.04 * leader_v_mps, leader_v_mps, 4.6,
            gap_m + 0.3, leader_v_mps - v_mps,
        )  # fmt: skip


@dataclass
class Traffic:
    """Vehicles in platoons on a straight road of 9 km."""

    vehicles: int = 100
    site: str = "local"
    anomalous: set[int] = field(default_factory=set)
    road_m: float = 9_000.0
    bearing_deg: float = 62.0
    shift_m: float = 0.0
    """How far north of the usual place the road is."""

    def states(self, elapsed_s: float, t_us: int) -> Iterator[PairState]:
        """Return the state of every vehicle."""
        heading = math.radians(self.bearing_deg)
        for i in range(self.vehicles):
            lane = i % 3
            v_mps = 24.0 + 2.0 * lane + 1.5 * math.sin(elapsed_s / 5 + i)
            spacing_m = self.road_m / max(1, self.vehicles // 3)
            along_m = ((i // 3) * spacing_m * (1 + 0.25 * math.sin(i)) + (24.0 + 2.0 * lane) * elapsed_s) % self.road_m
            north_m = along_m * math.cos(heading) - lane * 9 * math.sin(heading)
            east_m = along_m * math.sin(heading) + lane * 9 * math.cos(heading)
            standing = Standing.NORMAL
            if i in self.anomalous:
                standing = Standing.ANOMALOUS
            elif i % 29 == 7:
                standing = Standing.WARMING
            elif i % 97 == 11:
                standing = Standing.SILENT
            yield PairState(
                site=self.site,
                follower=f"veh-{i:04d}",
                leader=f"veh-{i + 3:04d}" if i + 3 < self.vehicles and i % 15 < 12 else None,
                t_us=t_us,
                standing=standing,
                lat=42.28 + (north_m + self.shift_m) / 111_195,
                lon=-83.74 + east_m / (111_195 * math.cos(math.radians(42.28))),
                heading_deg=self.bearing_deg,
                gap_m=28.0 + 6.0 * math.sin(i),
                x_m=along_m,
                offset_m=12.0 if i in self.anomalous else 0.2,
                v_mps=v_mps,
                nis=2.0,
                statistic=60.0 if i in self.anomalous else 2.0 + math.sin(elapsed_s + i),
                gate=GATE,
            )


def health(uptime_s: float, t_us: int, *, vehicles: int = 100, site: str = "local", instance: str = "rsu-1") -> Health:
    """Return a report of an instance that judged 10 messages a second of each vehicle."""
    records = int(10 * vehicles * uptime_s)
    return Health(
        instance=instance,
        site=site,
        t_us=t_us,
        version="0.1.0",
        model="headway",
        config_hash="7f3a91c2",
        ready=True,
        uptime_s=uptime_s,
        vehicles=vehicles,
        pairs=int(0.8 * vehicles),
        capacity=4_096,
        queue_depth=int(20 + 15 * math.sin(uptime_s)),
        queue_limit=50_000,
        scored=int(0.97 * records),
        warming=int(0.03 * records),
        rejected={"out_of_range": 41 + int(uptime_s), "duplicate": 17, "unavailable": 6, "too_old": 3},
        lost={"transport": 2},
        events=12,
        latency_ms={"p50": 1.6, "p99": 3.4 + 0.5 * math.sin(uptime_s / 2), "p999": 7.9, "max": 11.2},
        rss_mb=212.0,
    )


@dataclass
class Service:
    """Puts and keeps what a service would."""

    session: zenoh.Session
    keys: Keys
    journal: list[Event] = field(default_factory=list)
    handled: list[Handling] = field(default_factory=list)

    def publish(self, *messages: Event | PairState | Health) -> None:
        """Put messages where the service puts them; events go to the journal first."""
        for message in messages:
            match message:
                case Event():
                    self.journal.append(message)
                    key = self.keys.alert(message.kind, message.suspect)
                case PairState():
                    key = self.keys.pair_state(message.follower)
                case Health():
                    key = self.keys.health(message.instance)
            self.session.put(key, message.model_dump_json(), congestion_control=zenoh.CongestionControl.BLOCK)

    def answer(self, query: zenoh.Query) -> None:
        """Answer as the journal does."""
        with query:
            queries = AlertsQuery.from_parameters(dict(iter(query.parameters)))
            query.reply(self.keys.alerts, EVENTS.dump_json(found(self.journal, queries)))

    def handle(self, query: zenoh.Query) -> None:
        """Store and publish how a vehicle is handled, or list it."""
        with query:
            handled = self.handled
            if query.payload is not None:
                request = HandlingRequest.model_validate_json(query.payload.to_bytes())
                handled = [as_stored(self.keys.site, request)]
                self.handled += handled
                self.session.put(self.keys.handled(request.vehicle), handled[0].model_dump_json())
            query.reply(self.keys.handling, HANDLINGS.dump_json(handled))


def found(journal: list[Event], queries: AlertsQuery) -> list[Event]:
    """Return the page of a journal that a query asks for."""
    newest = {(e.site, e.event_id): e for e in journal}
    until_us = min(us for us in (queries.to_us, queries.before_us, 2**60) if us is not None)
    wanted = [
        e
        for e in journal
        if (queries.from_us or 0) <= e.detected_us < until_us
        and queries.kind in {None, e.kind}
        and queries.phase in {None, e.phase}
        and queries.event in {None, e.event_id}
        and queries.instance in {None, e.instance}
        and (e.sequence or 0) > (queries.after_sequence or -1)
        and queries.vehicle in {None, e.suspect, e.follower, e.leader}
        and any((queries.vehicle_part or "") in (vehicle or "") for vehicle in (e.suspect, e.follower, e.leader))
        and (e is newest[e.site, e.event_id] or not queries.newest)
    ]
    wanted.sort(key=lambda e: e.detected_us, reverse=True)
    last_us = wanted[queries.limit - 1].detected_us if len(wanted) > queries.limit else 0
    kept = [e for e in wanted if e.detected_us >= last_us]
    return kept if queries.evidence else [e.model_copy(update={"evidence": None}) for e in kept]


def as_stored(site: str, request: HandlingRequest) -> Handling:
    """Return a handling as the service stores it."""
    return Handling(**request.model_dump(), site=site, t_us=time.time_ns() // 1000)


class FakeFeed:
    """A feed without a bus: what is put into `heard` is what comes next."""

    def __init__(self, journal: list[Event] | None = None) -> None:
        self.received: list[SiteMessage] = []
        self.journal = journal
        self.queries: list[AlertsQuery] = []
        self.handled: list[Handling] = []
        self.connection = Connection(connected=True, connections=1, dropped=0, unreadable=0)
        self.started = self.closed = False

    def deliver(self, *messages: Message, site: str = "local") -> None:
        self.received += [SiteMessage(site, message) for message in messages]

    def start(self) -> None:
        self.started = True

    def drain(self) -> Iterator[SiteMessage]:
        taken, self.received = self.received, []
        return iter(taken)

    def history(self, sites: Sequence[str], query: AlertsQuery) -> History:
        self.queries.append(query)
        events = [e for e in found(self.journal or [], query) if e.site in sites]
        return History(events, answers=0 if self.journal is None else len(sites))

    def handlings(self, sites: Sequence[str]) -> list[Handling]:
        return [one for one in self.handled if one.site in sites]

    def handle(self, site: str, request: HandlingRequest) -> Handling | str:
        if self.journal is None:
            return "no journal"
        self.handled.append(as_stored(site, request))
        return self.handled[-1]

    def close(self) -> None:
        self.closed = True


def free_port() -> int:
    """Return a port that nobody listens on now."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        return int(listener.getsockname()[1])


def bus(mode: str, **endpoints: str) -> zenoh.Session:
    """Open a session that scouts for nobody: `listen` or `connect` one endpoint."""
    config = zenoh.Config()
    config.insert_json5("mode", f'"{mode}"')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("scouting/gossip/enabled", "false")
    for verb, endpoint in endpoints.items():
        config.insert_json5(f"{verb}/endpoints", f'["{endpoint}"]')
    return zenoh.open(config)


@contextmanager
def service(endpoint: str, journal: list[Event] | None = None, site: str = "local") -> Iterator[Service]:
    """Listen as a service does, with a journal that outlives it."""
    with bus("peer", listen=endpoint) as session:
        running = Service(session, Keys("v2x", site), [] if journal is None else journal)
        session.declare_queryable(running.keys.alerts, running.answer)
        session.declare_queryable(running.keys.handling, running.handle)
        yield running
