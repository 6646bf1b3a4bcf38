"""Somebody's own SUMO scenario, replayed: its vehicles, with injected faults."""

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from headway_loadtest.sources.drive import SourceError
from headway_loadtest.sources.sumo import run_program, simulate

needs_sumo = pytest.mark.skipif(find_spec("sumo") is None, reason="eclipse-sumo is not installed: headway[sumo]")


def scenario(folder: Path, *, projection: bool) -> Path:
    """Write a straight road with cars and trucks, in metres or with a projection, and return its configuration."""
    where = ("0", "0", "3000", "0") if not projection else ("11.00", "48.00", "11.04", "48.00")
    (folder / "nodes.xml").write_text(
        f'<nodes><node id="a" x="{where[0]}" y="{where[1]}"/><node id="b" x="{where[2]}" y="{where[3]}"/></nodes>'
    )
    (folder / "edges.xml").write_text('<edges><edge id="road" from="a" to="b" numLanes="1" speed="20"/></edges>')
    options = ("--proj.utm", "true") if projection else ()
    files = ("--node-files", "nodes.xml", "--edge-files", "edges.xml", "--output-file", "net.xml")
    run_program(folder, "netconvert", *files, *options)
    (folder / "routes.xml").write_text(
        '<routes><vType id="car" length="4.5"/><vType id="truck" length="12" maxSpeed="15"/>'
        '<route id="r" edges="road"/>'
        '<flow id="cars" type="car" route="r" begin="0" period="6" end="60" departSpeed="15"/>'
        '<flow id="trucks" type="truck" route="r" begin="3" period="12" end="60" departSpeed="12"/></routes>'
    )
    config = folder / "mine.sumocfg"
    config.write_text(
        '<configuration><net-file value="net.xml"/><route-files value="routes.xml"/>'
        '<step-length value="0.1"/></configuration>'
    )
    return config


@needs_sumo
@pytest.mark.parametrize("projection", [False, True])
def test_the_scenario_of_a_researcher_is_simulated(tmp_path: Path, projection: bool) -> None:
    config, fcd = scenario(tmp_path, projection=projection), tmp_path / "fcd.xml"
    simulate(config, 20.0, 1, fcd)
    text = fcd.read_text()
    assert {'type="car"', 'type="truck"'} <= set(text.split())
    x = float(text.partition(' x="')[2].partition('"')[0])
    assert (10.9 < x < 11.1) if projection else x < 100.0


@needs_sumo
@pytest.mark.parametrize("projection", [False, True])
def test_its_vehicles_are_replayed_with_faults(tmp_path: Path, projection: bool) -> None:
    from rich.console import Console

    from headway.cli.run.recorded.refusals import Reading
    from headway.cli.run.recorded.scenes import simulated
    from headway.cli.run.replay import Request, frames_of

    config = scenario(tmp_path, projection=projection)
    reading = simulated(Reading([f"sumo:{config}"]), 30.0, 1, tmp_path, Console(quiet=True))
    clean, length_s = frames_of(Request(reading, "local", 1.0, None, 1, 30.0))
    assert 29.0 < length_s <= 30.0
    frames = list(clean)
    vehicles = {vehicle.id for frame in frames for vehicle in frame.entering}
    assert {"cars.0", "cars.1", "trucks.0"} <= vehicles
    row = next(vehicle.row for vehicle in frames[0].entering if vehicle.id == "cars.0")
    t_s, lat, lon, speed_mps = (
        np.concatenate([getattr(frame, name)[frame.row == row] for frame in frames])
        for name in ("t_us", "lat", "lon", "speed_mps")
    )
    east_m = np.diff(np.radians(lon)) * 6_378_137 * np.cos(np.radians(lat[0]))
    assert east_m == pytest.approx(np.diff(t_s) / 1e6 * speed_mps[1:], abs=0.1)
    faulty, _ = frames_of(Request(reading, "local", 1.0, "c=1,share=0.9", 1, 30.0))
    list(faulty)
    assert {label.vehicle for label in faulty.labels} & vehicles


def test_a_scenario_that_does_not_run_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match=r"sumo:nowhere\.sumocfg: no such file"):
        simulate(Path("nowhere.sumocfg"), 1.0, 1, tmp_path / "fcd.xml")


@needs_sumo
def test_what_sumo_refuses_is_its_own_first_line(tmp_path: Path) -> None:
    (tmp_path / "bad.sumocfg").write_text('<configuration><net-file value="absent.xml"/></configuration>')
    with pytest.raises(SourceError, match=r"sumo: Error: .*absent"):
        simulate(tmp_path / "bad.sumocfg", 1.0, 1, tmp_path / "fcd.xml")
