"""`headway replay`: what it says before anything is sent, and who is on the road."""

import socket

import numpy as np
import pytest
from fake_service import free_port
from typer.testing import CliRunner

from headway.cli.app import app
from headway.cli.run.replay import Request, frames_of
from headway.errors import UserError
from headway_loadtest.sources import SourceError


def request(*sources: str, inject: str | None = None, seconds: float = 1.0) -> Request:
    return Request(sources, "local", 1.0, inject, 3, seconds)


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
