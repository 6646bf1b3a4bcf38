"""Somebody's own SUMO scenario, replayed: its vehicles, with injected faults."""

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from headway.cli.run.recorded.refusals import Reading
from headway.cli.run.replay import Request, frames_of
from headway.errors import UserError
from headway_loadtest.sources.drive import SourceError
from headway_loadtest.sources.sumo import run_program
from headway_loadtest.traffic.frames import Frame
from headway_loadtest.traffic.sumo_frames import SumoFrames

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


def replayed(config: Path, seconds: float = 30.0, inject: str | None = None, seed: int = 1) -> SumoFrames:
    frames, length_s = frames_of(Request(Reading([f"sumo:{config}"]), "local", 1.0, inject, seed, seconds))
    assert isinstance(frames, SumoFrames)
    assert length_s == seconds
    return frames


def column(frames: list[Frame], row: int, name: str) -> np.ndarray:
    return np.concatenate([getattr(frame, name)[frame.row == row] for frame in frames])


def rows_of(frames: list[Frame]) -> dict[str, int]:
    return {vehicle.id: vehicle.row for frame in frames for vehicle in frame.entering}


@needs_sumo
@pytest.mark.parametrize("projection", [False, True])
def test_the_vehicles_of_a_researcher_are_sent_as_they_drive(tmp_path: Path, projection: bool) -> None:
    frames = list(replayed(scenario(tmp_path, projection=projection)))
    rows = rows_of(frames)
    assert {"cars.0", "cars.1", "trucks.0"} <= set(rows)
    lengths = {vehicle.id: vehicle.length_m for frame in frames for vehicle in frame.entering}
    assert (lengths["cars.0"], lengths["trucks.0"]) == (4.5, 12.0)
    t_us, lat, lon, speed_mps, msg_cnt, heading_deg = (
        column(frames, rows["cars.0"], name) for name in ("t_us", "lat", "lon", "speed_mps", "msg_cnt", "heading_deg")
    )
    assert np.diff(t_us).tolist() == [100_000] * (len(t_us) - 1)
    assert msg_cnt.tolist() == [n % 128 for n in range(len(t_us))]
    assert 280 <= len(t_us) <= 300
    assert lat == pytest.approx(np.full(len(lat), 48.0), abs=1e-4)
    assert heading_deg == pytest.approx(np.full(len(lat), 90.0), abs=2.0)  # grid north of UTM
    east_m = np.diff(np.radians(lon)) * 6_378_137 * np.cos(np.radians(lat[0]))
    assert east_m == pytest.approx(0.1 * speed_mps[1:], abs=0.1)


@needs_sumo
def test_the_scenario_is_stepped_while_it_is_sent(tmp_path: Path) -> None:
    frames = iter(replayed(scenario(tmp_path, projection=False), seconds=1e6))
    assert [int(next(frames).t_us[0]) for _ in range(3)] == [0, 100_000, 200_000]
    frames.close()


@needs_sumo
def test_faults_are_what_is_added_and_their_labels_say_when(tmp_path: Path) -> None:
    config = scenario(tmp_path, projection=False)
    clean = list(replayed(config))
    faulty = replayed(config, inject="c=4,p=0.02,kinds=bias+miss,share=0.7")
    sent = list(faulty)
    rows = rows_of(clean)
    assert rows_of(sent) == rows
    assert faulty.labels
    assert {label.vehicle for label in faulty.labels} < set(rows)
    for vehicle, row in rows.items():
        labels = [label for label in faulty.labels if label.vehicle == vehicle]
        t_us = column(sent, row, "t_us")
        before = dict(zip(column(clean, row, "t_us").tolist(), column(clean, row, "speed_mps").tolist(), strict=True))
        differs = t_us[np.array([before[t] for t in t_us.tolist()]) != column(sent, row, "speed_mps")]
        said = [label for label in labels if label.sensor == "speed"]
        within = [t for t in t_us.tolist() if any(label.start_us <= t <= label.stop_us for label in said)]
        assert differs.tolist() == within
        gaps = [(t_us[i], t_us[i + 1]) for i in np.flatnonzero(np.diff(t_us) > 100_000)]
        assert gaps == [(label.start_us, label.stop_us) for label in labels if label.sensor == "link"]


@needs_sumo
def test_the_same_seed_replays_the_same(tmp_path: Path) -> None:
    config = scenario(tmp_path, projection=False)
    one, again = (list(replayed(config, 10.0, "c=1")) for _ in range(2))
    assert [frame.speed_mps.tolist() for frame in one] == [frame.speed_mps.tolist() for frame in again]


@needs_sumo
def test_a_scenario_ends_when_nobody_is_left(tmp_path: Path) -> None:
    frames = list(replayed(scenario(tmp_path, projection=False), seconds=10_000.0))
    assert frames[-1].t_us[0] < 400e6


def test_what_cannot_be_replayed_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match=r"sumo:nowhere\.sumocfg: no such file"):
        list(replayed(Path("nowhere.sumocfg")))
    with pytest.raises(SourceError, match="need whole drives"):
        replayed(tmp_path, inject="kinds=replay")
    with pytest.raises(UserError, match="by itself"):
        frames_of(Request(Reading(["sumo:a.sumocfg", "synthetic:3"]), "local", 1.0, None, 1, 1.0))


@needs_sumo
def test_what_sumo_refuses_is_its_own_first_line(tmp_path: Path) -> None:
    (tmp_path / "bad.sumocfg").write_text('<configuration><net-file value="absent.xml"/></configuration>')
    with pytest.raises(SourceError, match=r"sumo: Error: .*absent"):
        list(replayed(tmp_path / "bad.sumocfg"))
