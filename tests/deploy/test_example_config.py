"""The example of a configuration is one that the service starts with, and agrees with the rest of the folder."""

import tomllib

import pytest
from deploy.manifest import ROOT, settings_of
from typer.testing import CliRunner

from headway.cli.app import app
from headway.settings import ENV_PREFIX

EXAMPLE = ROOT / "deploy" / "headway.toml"


def test_the_check_accepts_it() -> None:
    result = CliRunner().invoke(app, ["config", "check", "--config", str(EXAMPLE)])
    assert (result.exit_code, result.stdout.split(":")[0]) == (0, "settings are right")


def test_it_speaks_as_a_member_of_the_bus(monkeypatch: pytest.MonkeyPatch) -> None:
    settings = settings_of({}, monkeypatch, EXAMPLE)
    members = tomllib.loads((ROOT / "deploy/zenoh/members.toml").read_text())
    assert settings.instance in members["sites"][settings.site]["services"]
    assert settings.prefix == members["prefix"]


def test_what_repeats_a_default_repeats_it_rightly(monkeypatch: pytest.MonkeyPatch) -> None:
    written = tomllib.loads(EXAMPLE.read_text())
    settings = settings_of({f"{ENV_PREFIX}SITE": "elsewhere"}, monkeypatch, EXAMPLE)
    assert settings.site == "elsewhere"
    assert {name: getattr(settings, name) for name in ("alarm_budget_per_hour", "vehicle_capacity", "http_port")} == {
        name: written[name] for name in ("alarm_budget_per_hour", "vehicle_capacity", "http_port")
    }
