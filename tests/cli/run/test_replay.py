"""`headway replay`: what it says before anything is sent, and who is on the road."""

import socket
from pathlib import Path

import numpy as np
import pytest
from fake_service import free_port
from gateways.recordings.made_files import ABSOLUTE_US, BSM_P1_HEADER, MADE, READINGS, STEPS, bsm_p1_row
from typer.testing import CliRunner

from headway.cli.app import app
from headway.cli.run.recorded.refusals import Reading
from headway.cli.run.replay import Request, frames_of
from headway.errors import UserError
from headway_loadtest.sources import SourceError


def request(*sources: str, inject: str | None = None, seconds: float = 1.0) -> Request:
    return Request(Reading(sources), "local", 1.0, inject, 3, seconds)


@pytest.mark.parametrize("count", [3, 700])
def test_so_many_synthetic_vehicles_drive_at_once(count: int) -> None:
    frames, length_s = frames_of(request(f"synthetic:{count}"))
    made = list(frames)
    first = [frame for frame in made if frame.t_us[-1] <= 100_000]
    assert np.unique(np.concatenate([frame.row for frame in first])).size == count
    assert (length_s, sum(map(len, made))) == (1.0, 10 * count)


def test_kinds_that_need_whole_drives_have_their_vehicles_at_once_too() -> None:
    frames, _ = frames_of(request("synthetic:40", inject="c=1,kinds=drag,share=0.1"))
    second = [frame for frame in frames if 200_000 <= frame.t_us[0] < 400_000]
    assert np.unique(np.concatenate([frame.row for frame in second])).size == 40


def test_more_than_can_drive_at_once_are_refused() -> None:
    with pytest.raises(SourceError, match="at most 5000 vehicles"):
        frames_of(request("synthetic:5001"))
    with pytest.raises(UserError, match="at most 500 synthetic vehicles"):
        frames_of(request("synthetic:501", inject="kinds=replay"))
    with pytest.raises(UserError, match="at most 500 synthetic vehicles"):
        frames_of(request("synthetic:300", "synthetic:300"))


def refusal(*args: str) -> tuple[str, str]:
    result = CliRunner().invoke(app, ["replay", "synthetic:5", *args])
    assert isinstance(result.exception, UserError)
    return result.output, str(result.exception)


def test_it_says_that_it_connects_and_gives_up_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    said, problem = refusal("--connect", endpoint)
    assert said.strip() == f"Connecting to {endpoint} ..."
    assert problem == f"nothing answers at {endpoint} within 5 s: start `headway serve` or a router there"


def test_an_endpoint_that_accepts_and_is_silent_is_given_up_too() -> None:
    with socket.create_server(("127.0.0.1", 0)) as mute:
        _, problem = refusal("--connect", f"tcp/127.0.0.1:{mute.getsockname()[1]}")
    assert "within 5 s" in problem


@pytest.mark.parametrize("endpoint", ["nonsense", "tcp/"])
def test_no_place_in_the_sources_of_zenoh_is_shown(endpoint: str) -> None:
    _, problem = refusal("--connect", endpoint)
    assert "is no zenoh endpoint: write it like tcp/127.0.0.1:7447" in problem
    assert ".rs" not in problem


def test_two_endpoints_are_refused() -> None:
    _, problem = refusal("--connect", "tcp/127.0.0.1:1", "--connect", "tcp/127.0.0.1:2")
    assert "connects to one endpoint" in problem


def test_every_format_is_replayed_as_it_is(tmp_path: Path) -> None:
    for name, made in MADE.items():
        path = tmp_path / name
        made.write(path)
        frames, length_s = frames_of(request(str(path), seconds=60.0))
        played = list(frames)
        assert length_s == pytest.approx((STEPS - 1) / 10, abs=0.2), name
        assert {vehicle.id for frame in played for vehicle in frame.entering} == set(made.ids), name
        lat = np.sort(np.concatenate([frame.lat for frame in played]))
        assert lat == pytest.approx(np.sort([one.lat for one in READINGS]), abs=1e-7), name


def test_drives_of_other_days_are_replayed_one_after_the_other(tmp_path: Path) -> None:
    path = tmp_path / "BsmP1.csv"
    rows = [bsm_p1_row(one, us=ABSOLUTE_US + day * 86_400_000_000) for day in (1, 0) for one in READINGS]
    path.write_text("\n".join([BSM_P1_HEADER, *rows]))
    times_us = np.concatenate([frame.t_us for frame in frames_of(request(str(path), seconds=600.0))[0]])
    assert len(times_us) == len(rows)
    assert np.diff(times_us).max() >= 35e6


def test_a_table_of_ones_own_is_replayed_by_its_mapping(tmp_path: Path) -> None:
    path = tmp_path / "mine.csv"
    path.write_text("who,when,y,x,v\n" + "".join(f"a,{one.t_s},{one.lat},{one.lon},20\n" for one in READINGS[::2]))
    reading = Reading([str(path)], columns="id=who,t=when,lat=y,lon=x,speed=v[mph]")
    frames, _ = frames_of(Request(reading, "local", 1.0, None, 3, 60.0))
    assert np.concatenate([frame.speed_mps for frame in frames]) == pytest.approx(8.9408)


def test_a_recording_and_another_source_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "fcd.xml"
    MADE["fcd-geo.xml"].write(path)
    with pytest.raises(SourceError, match="recordings are replayed by themselves"):
        frames_of(request(str(path), "synthetic:3"))


def test_a_folder_is_replayed_as_its_recordings(tmp_path: Path) -> None:
    MADE["bsmp1.csv"].write(tmp_path / "BSMP1.CSV")
    frames, _ = frames_of(request(str(tmp_path), seconds=60.0))
    assert sum(map(len, frames)) == len(READINGS)
    (tmp_path / "DataFrontTargets.csv").write_text("Device,Trip\n")
    with pytest.raises(SourceError, match="DataWsu"):
        frames_of(request(str(tmp_path)))
