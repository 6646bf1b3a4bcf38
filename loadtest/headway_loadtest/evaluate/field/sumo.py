"""Traffic that nobody here wrote: SUMO scenarios, seeded, with receiver errors on top of the true readings.

Source names are `sumo`, `sumo:SCENARIO` and `sumo:SCENARIO-DRIVER`; each gives one recording for every receiver of
`RECEIVERS`.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from xml.etree import ElementTree as ET

import numpy as np
import polars as pl

from headway_loadtest.evaluate.field.faults import rng_of
from headway_loadtest.evaluate.field.gnss import GnssError, add_gnss_error, shift
from headway_loadtest.evaluate.field.recordings import DELAY_US, T0_US, Recording, assemble, empty
from headway_loadtest.sources.drive import SourceError
from headway_loadtest.sources.sumo import run_program

PREFIX = "sumo"
ORIGIN_LAT, ORIGIN_LON = 48.0, 11.0
STEP_S = 0.1
WARM_UP_S = 120.0
"""Traffic builds up before the recording begins."""
DRIVERS = ("IDM", "EIDM")
"""Car-following models: the intelligent driver model, and the one of Salles, Kaufmann and Reuss (2020) with reaction
and estimation errors."""
RECEIVERS = (GnssError(0.3, 0.05), GnssError(0.5, 0.2))
LENGTHS_M = (3.8, 5.2)
SPEED_FACTOR = (0.8, 1.2)
LANE_CHANGE = {"lcMaxSpeedLatStanding": "0", "lcMaxSpeedLatFactor": "0.1"}
"""A car that stands does not slide sideways, and none moves sideways by more than a tenth of its speed."""


@dataclass(frozen=True, slots=True)
class Scenario:
    """A road network, and how often a vehicle enters it. `build` writes `net.xml` into the folder."""

    build: Callable[[Path, int], None]
    period_s: float


def recordings(source: str, minutes: float, seed: int) -> Iterator[Recording]:
    """Simulate the traffic that `source` names, and yield what receivers in it would send.

    Raises
    ------
    SourceError
        The name is not one of `names()`, SUMO is not installed, or one of its programs fails.
    """
    wanted = [name for name in names() if name == source or name.startswith(f"{source}-") or source == PREFIX]
    if not wanted:
        raise SourceError(f"{source}: no such traffic; choose from {PREFIX}, {', '.join(names())}")
    for name in wanted:
        scenario, _, driver = name.removeprefix(f"{PREFIX}:").partition("-")
        truth = simulate(scenario, driver.upper(), minutes, seed)
        yield from (received(truth, error, seed) for error in RECEIVERS)


def names() -> tuple[str, ...]:
    """Return the names of all traffic."""
    return tuple(f"{PREFIX}:{scenario}-{driver.lower()}" for scenario in SCENARIOS for driver in DRIVERS)


def simulate(scenario: str, driver: str, minutes: float, seed: int) -> Recording:
    """Run SUMO and return the true readings, ten a second, of every vehicle on the road."""
    with TemporaryDirectory(prefix="headway-sumo-") as made:
        folder = Path(made)
        SCENARIOS[scenario].build(folder, seed)
        end_s = WARM_UP_S + 60.0 * minutes
        _write_trips(folder, driver, SCENARIOS[scenario].period_s, end_s, seed)
        run_program(
            folder,
            "sumo",
            *("--net-file", "net.xml", "--route-files", "trips.xml", "--seed", f"{seed}"),
            *("--step-length", f"{STEP_S}", "--end", f"{end_s}", "--step-method.ballistic", "true"),
            *("--lanechange.duration", "3", "--time-to-teleport", "-1", "--collision.action", "none"),
            *("--fcd-output", "fcd.csv", "--fcd-output.acceleration", "true", "--precision", "4"),
            *("--no-step-log", "true"),
        )
        return _read_fcd(folder / "fcd.csv", f"sumo-{scenario}-{driver.lower()}")


def received(truth: Recording, error: GnssError, seed: int) -> Recording:
    """Return the recording with a receiver's error on every vehicle; the set's name gives its standard deviations."""
    tracks = truth.tracks
    for vehicle, track in zip(truth.vehicles, tracks, strict=True):
        add_gnss_error(rng_of((seed, round(error.position_m * 1e3)), vehicle), track, error)
    named = replace(truth, group=f"{truth.group}-{error.position_m:g}m")
    return assemble(named, tracks)


def _read_fcd(path: Path, group: str) -> Recording:
    """Read SUMO's floating car data; positions are those of the front of each vehicle."""
    table = pl.read_csv(path, separator=";", schema_overrides={"vehicle_id": pl.String}).filter(
        pl.col("timestep_time") >= WARM_UP_S
    )
    if table.is_empty():
        raise SourceError(f"{group}: no vehicle on the road; ask for more minutes")
    vehicles, which = np.unique(table["vehicle_id"].to_numpy().astype(np.str_), return_inverse=True)
    messages = empty(table.height)
    messages["vehicle"] = which
    messages["t_us"] = T0_US + np.round(table["timestep_time"].to_numpy() * 1e6).astype(np.int64)
    messages["received_us"] = messages["t_us"] + DELAY_US
    messages["lat_deg"], messages["lon_deg"] = ORIGIN_LAT, ORIGIN_LON
    shift(messages, table["vehicle_y"].to_numpy(), table["vehicle_x"].to_numpy())
    messages["speed_mps"] = table["vehicle_speed"].to_numpy()
    messages["heading_deg"] = table["vehicle_angle"].to_numpy()
    messages["accel_mps2"] = table["vehicle_acceleration"].to_numpy()
    lengths = {name: float(rng_of((0,), name).uniform(*LENGTHS_M)) for name in vehicles.tolist()}
    messages["length_m"] = np.array([lengths[name] for name in vehicles.tolist()])[which]
    bare = Recording(group=group, name=group, vehicles=tuple(vehicles.tolist()), messages=messages)
    tracks = bare.tracks
    for track in tracks:
        track["msg_cnt"] = np.arange(len(track)) % 128
    return assemble(bare, tracks)


def _write_trips(folder: Path, driver: str, period_s: float, end_s: float, seed: int) -> None:
    """Write random trips from an edge that enters the network to one that leaves it."""
    rng = np.random.default_rng(seed)
    entries, exits = _fringe(folder / "net.xml")
    root = ET.Element("routes")
    depart_s, count = 0.0, 0
    while depart_s < end_s:
        name = f"{count:04d}"
        length_m = float(rng_of((0,), name).uniform(*LENGTHS_M))
        kind = {"id": f"type{name}", "carFollowModel": driver, "length": f"{length_m:.2f}"} | LANE_CHANGE
        kind["speedFactor"] = f"{rng.uniform(*SPEED_FACTOR):.3f}"
        ET.SubElement(root, "vType", kind)
        start = entries[int(rng.integers(len(entries)))]
        stops = [name for name in exits if name[1] != start[1]]
        stop = stops[int(rng.integers(len(stops)))]
        trip = {"id": name, "type": f"type{name}", "depart": f"{depart_s:.1f}", "from": start[0], "to": stop[0]}
        ET.SubElement(root, "trip", trip | {"departLane": "best", "departSpeed": "max"})
        depart_s, count = depart_s + float(rng.exponential(period_s)), count + 1
    ET.ElementTree(root).write(folder / "trips.xml")


def _fringe(net: Path) -> tuple[list[tuple[str, str]], list[tuple[str, str]]]:
    """Return (edge, node at the fringe) of the edges that enter the network, and of those that leave it."""
    root = ET.parse(net).getroot()  # noqa: S314 - SUMO wrote it
    edges = [edge.attrib for edge in root.iter("edge") if edge.get("function") is None]
    neighbours: dict[str, set[str]] = {}
    for edge in edges:
        neighbours.setdefault(edge["from"], set()).add(edge["to"])
        neighbours.setdefault(edge["to"], set()).add(edge["from"])
    fringe = {node for node, others in neighbours.items() if len(others) == 1}
    entries = sorted((edge["id"], edge["from"]) for edge in edges if edge["from"] in fringe)
    exits = sorted((edge["id"], edge["to"]) for edge in edges if edge["to"] in fringe)
    return entries, exits


def _build_urban(folder: Path, seed: int) -> None:
    """Make a grid of three by three junctions with lights, 200 m apart, two lanes each way."""
    run_program(
        folder,
        "netgenerate",
        *("--grid", "--grid.number", "3", "--grid.length", "200", "--grid.attach-length", "200"),
        *("--default.lanenumber", "2", "--default.speed", "13.89", "--default.junctions.type", "traffic_light"),
        *("--no-turnarounds", "true", "--junctions.internal-link-detail", "20"),
        *("--seed", f"{seed}", "--output-file", "net.xml"),
    )


NODES = {"west": (0, 0), "merge": (1200, 0), "part": (2000, 0), "east": (3200, 0), "on": (700, -90), "off": (2500, -90)}
EDGES = (
    ("west", "merge", 3, 33.33),
    ("merge", "part", 4, 33.33),
    ("part", "east", 3, 33.33),
    ("on", "merge", 1, 25.0),
    ("part", "off", 1, 25.0),
)
"""Start, end, lanes, speed limit. Lanes are straight: SUMO gives lanes of a curve one length, so that a car which
changes lanes there leaps along the road."""


def _build_highway(folder: Path, _seed: int) -> None:
    """Make one direction of a highway, 3.2 km long, three lanes, with an entry and an exit."""
    nodes, edges = ET.Element("nodes"), ET.Element("edges")
    for name, (x_m, y_m) in NODES.items():
        ET.SubElement(nodes, "node", {"id": name, "x": f"{x_m}", "y": f"{y_m}"})
    for start, stop, lanes, mps in EDGES:
        road = {"id": f"{start}-{stop}", "from": start, "to": stop, "numLanes": f"{lanes}", "speed": f"{mps}"}
        ET.SubElement(edges, "edge", road)
    ET.ElementTree(nodes).write(folder / "nodes.xml")
    ET.ElementTree(edges).write(folder / "edges.xml")
    run_program(
        folder, "netconvert", "--node-files", "nodes.xml", "--edge-files", "edges.xml", "--output-file", "net.xml"
    )


SCENARIOS: Mapping[str, Scenario] = MappingProxyType(
    {"urban": Scenario(_build_urban, 4.0), "highway": Scenario(_build_highway, 3.0)}
)
