"""Where a command finds the bus."""

from pathlib import Path

import pytest

from headway.cli.run.bus import bus_access, only
from headway.errors import UserError
from headway.settings import SettingsError


def test_without_options_it_is_the_service_of_this_machine() -> None:
    bus = bus_access(None)
    assert (bus.endpoints, bus.prefix, bus.site, bus.zenoh_config) == (("tcp/127.0.0.1:7447",), "v2x", "local", None)


def test_the_file_says_it_the_environment_wins_and_options_win_over_both(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "headway.toml"
    file.write_text('site = "crossing"\nprefix = "city/v2x"\nlisten = ["tcp/0.0.0.0:7000", "tls/[::]:7001"]\n')
    bus = bus_access(file)
    assert (bus.endpoints, bus.prefix, bus.site) == (("tcp/127.0.0.1:7000",), "city/v2x", "crossing")
    monkeypatch.setenv("HEADWAY_SITE", "bridge")
    monkeypatch.setenv("HEADWAY_CONNECT", "tcp/router-a:7447,tcp/router-b:7447")
    bus = bus_access(file)
    assert (bus.endpoints, bus.site) == (("tcp/router-a:7447", "tcp/router-b:7447"), "bridge")
    assert bus_access(file, ["tcp/elsewhere:1"]).endpoints == ("tcp/elsewhere:1",)
    monkeypatch.setenv("HEADWAY_SIET", "bridge")
    with pytest.raises(SettingsError, match="did you mean HEADWAY_SITE"):
        bus_access(None)


@pytest.mark.parametrize(
    ("listen", "reached"),
    [
        ("tcp/[::]:7447", "tcp/[::1]:7447"),
        ("quic/0.0.0.0:7447#iface=eth0", "quic/127.0.0.1:7447#iface=eth0"),
        ("tcp/10.0.0.0:7447", "tcp/10.0.0.0:7447"),
    ],
)
def test_a_service_on_every_address_is_reached_on_the_loopback(
    listen: str, reached: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HEADWAY_LISTEN", listen)
    assert bus_access(None).endpoints == (reached,)


def test_a_file_of_zenoh_keeps_its_endpoints(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "zenoh.json5"
    assert bus_access(None, zenoh_config=file).endpoints == ()
    monkeypatch.setenv("HEADWAY_ZENOH_CONFIG", str(file))
    assert (bus_access(None).endpoints, bus_access(None).zenoh_config) == ((), file)
    monkeypatch.setenv("HEADWAY_LISTEN", "tls/127.0.0.1:7448")
    assert bus_access(None).endpoints == ("tls/127.0.0.1:7448",)


def test_a_command_that_takes_one_endpoint_refuses_two() -> None:
    assert only(None) is None
    assert only(["a/b:1"]) == "a/b:1"
    with pytest.raises(UserError, match="--connect a/b:1 --connect c/d:2: this command connects to one"):
        only(["a/b:1", "c/d:2"])
