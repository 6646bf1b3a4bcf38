"""Settings: a setting has one name everywhere, and nothing unknown or impossible gets past the start."""

import json
import os
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import pytest

from headway.core.types.config import DetectorConfig
from headway.settings import Origin, Settings, SettingsError, load


@pytest.fixture(autouse=True)
def _clean_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in os.environ:
        if name.upper().startswith("HEADWAY_"):
            monkeypatch.delenv(name)


@pytest.fixture
def toml(tmp_path: Path):
    def write(text: str) -> Path:
        path = tmp_path / "headway.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def refusal(file: Path | None = None) -> str:
    with pytest.raises(SettingsError) as caught:
        load(file)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_every_number_of_the_detector_is_a_setting_with_its_default() -> None:
    assert {f.name for f in fields(DetectorConfig)} <= Settings.model_fields.keys()
    assert load().settings.detector() == DetectorConfig()


def test_the_environment_wins_over_the_file_and_the_file_over_the_default(toml, monkeypatch) -> None:
    monkeypatch.setenv("HEADWAY_DELAY_S", "1.5")
    loaded = load(toml('delay_s = 0.25\nsite = "east-1"\n'))
    assert (loaded.settings.delay_s, loaded.settings.site, loaded.settings.prefix) == (1.5, "east-1", "v2x")
    assert [loaded.origins[name] for name in ("delay_s", "site", "prefix")] == [
        Origin.ENVIRONMENT,
        Origin.FILE,
        Origin.DEFAULT,
    ]


@pytest.mark.parametrize("written", ['["tcp/127.0.0.1:7447"]', "127.0.0.1:7447", "tcp/", "tcp:7447"])
def test_what_is_no_endpoint_stops_the_start_with_how_one_is_written(monkeypatch, written: str) -> None:
    monkeypatch.setenv("HEADWAY_LISTEN", written)
    assert "like tcp/10.0.0.1:7447; commas separate several" in refusal()


def test_endpoints_of_the_environment_are_separated_by_commas_or_blanks(monkeypatch) -> None:
    monkeypatch.setenv(
        "HEADWAY_CONNECT", "tcp/[::1]:7447, tls/router.example:7448#so_rcvbuf=65000 unixsock-stream//run/h.sock"
    )
    assert load().settings.connect == (
        "tcp/[::1]:7447",
        "tls/router.example:7448#so_rcvbuf=65000",
        "unixsock-stream//run/h.sock",
    )


def test_an_unknown_name_in_the_file_stops_the_start_with_the_nearest_right_one(toml) -> None:
    assert "unknown setting dealy_s" in refusal(toml("dealy_s = 1\n"))
    assert "did you mean delay_s?" in refusal(toml("dealy_s = 1\n"))


def test_an_unknown_name_in_the_environment_stops_the_start_with_the_nearest_right_one(monkeypatch) -> None:
    monkeypatch.setenv("HEADWAY_VEHICLES_CAPACITY", "5")
    assert "unknown setting HEADWAY_VEHICLES_CAPACITY in the environment" in refusal()
    assert "did you mean HEADWAY_VEHICLE_CAPACITY?" in refusal()


@pytest.mark.parametrize(("old", "new"), [("miss_after_s", "silence_timeout_s"), ("forget_after_s", "vehicle_ttl_s")])
def test_a_name_of_an_earlier_version_is_refused_with_the_name_that_it_has_now(toml, old: str, new: str) -> None:
    assert refusal(toml(f"{old} = 1\n")).endswith(f"did you mean {new}?")


def test_a_number_of_the_detector_is_a_float_whatever_was_given() -> None:
    config = DetectorConfig(max_gap_s=5, delay_s=1)
    assert (type(config.max_gap_s), type(config.delay_s), type(config.vehicle_capacity)) == (float, float, int)
    assert config == DetectorConfig(max_gap_s=5.0, delay_s=1.0)


def test_a_name_like_no_other_is_refused_without_a_guess(monkeypatch) -> None:
    monkeypatch.setenv("HEADWAY_ZZZ", "5")
    assert "did you mean" not in refusal()


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [
        ("HEADWAY_DELAY_S", "9", "number from 0 to 5 s"),
        ("HEADWAY_DELAY_S", "soon", "number from 0 to 5 s"),
        ("HEADWAY_DELAY_S", "nan", "number from 0 to 5 s"),
        ("HEADWAY_MODEL", "lstm", "ekf, aekf, headway"),
        ("HEADWAY_SITE", "a/b", "text matching"),
        ("HEADWAY_EVIDENCE_READINGS", "7", "integer from 4 to 1000"),
        ("HEADWAY_ALARM_BUDGET_PER_HOUR", "0", "number above 0 to 3600 1/h"),
    ],
)
def test_a_value_that_is_not_allowed_is_named_with_what_is(monkeypatch, name: str, value: str, allowed: str) -> None:
    monkeypatch.setenv(name, value)
    assert refusal().startswith(f"{name} = {value!r}: ")
    assert f"(allowed: {allowed}" in refusal()


def test_a_value_of_the_file_is_named_as_in_the_file(toml) -> None:
    assert refusal(toml("http_port = 70000\n")).startswith("http_port = 70000: ")


def test_a_file_that_is_missing_or_no_toml_is_named(toml, tmp_path: Path) -> None:
    assert "No such file" in refusal(tmp_path / "absent.toml")
    assert "not TOML" in refusal(toml("delay_s: 1\n"))


def test_endpoints_are_a_list_in_the_file_and_apart_by_commas_in_the_environment(toml, monkeypatch) -> None:
    assert load(toml('connect = ["tcp/a:1", "tcp/b:2"]\n')).settings.connect == ("tcp/a:1", "tcp/b:2")
    monkeypatch.setenv("HEADWAY_CONNECT", "tcp/c:3, tcp/d:4")
    assert load().settings.connect == ("tcp/c:3", "tcp/d:4")
    monkeypatch.setenv("HEADWAY_CONNECT", "")
    assert load().settings.connect == ()


def test_a_client_needs_somebody_to_connect_to(monkeypatch) -> None:
    monkeypatch.setenv("HEADWAY_MODE", "client")
    assert "connect" in refusal()
    monkeypatch.setenv("HEADWAY_CONNECT", "tcp/10.0.0.1:7447")
    assert load().settings.mode == "client"


def test_the_hash_follows_what_changes_a_verdict_and_nothing_else(monkeypatch) -> None:
    before = load().settings.config_hash
    monkeypatch.setenv("HEADWAY_HTTP_PORT", "0")
    assert load().settings.config_hash == before
    monkeypatch.setenv("HEADWAY_DELAY_S", "0.6")
    assert load().settings.config_hash != before


def test_every_setting_says_what_it_is() -> None:
    assert [name for name, field in Settings.model_fields.items() if not field.description] == []


def headway(*arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
    environment = {k: v for k, v in os.environ.items() if not k.upper().startswith("HEADWAY_")} | variables
    return subprocess.run(
        [sys.executable, "-m", "headway", *arguments], env=environment, capture_output=True, text=True, check=False
    )


def test_config_show_tells_value_and_origin() -> None:
    shown = json.loads(headway("config", "show", "--json", HEADWAY_SITE="east").stdout)
    assert shown["site"] == {"value": "east", "origin": "environment"}
    assert shown["delay_s"] == {"value": 0.5, "origin": "default"}


def test_config_check_ends_with_status_2_and_one_line_when_something_is_wrong() -> None:
    wrong = headway("config", "check", HEADWAY_SIT="east")
    assert (wrong.returncode, wrong.stdout, wrong.stderr.count("\n")) == (2, "", 1)
    assert "did you mean HEADWAY_SITE?" in wrong.stderr
    assert headway("config", "check").returncode == 0


def test_config_schema_gives_every_setting_its_unit_and_bounds() -> None:
    schema = json.loads(headway("config", "schema").stdout)
    assert schema["properties"]["delay_s"]["unit"] == "s"
    assert schema["properties"]["delay_s"]["maximum"] == 5
    assert schema["properties"].keys() == Settings.model_fields.keys()


def test_the_snapshot_is_in_the_folder_in_memory_that_systemd_made(monkeypatch) -> None:
    assert load().settings.snapshot_dir is None
    monkeypatch.setenv("RUNTIME_DIRECTORY", "/run/headway:/run/other")
    assert load().settings.snapshot_dir == Path("/run/headway")
    monkeypatch.setenv("HEADWAY_SNAPSHOT_DIR", "/dev/shm/headway")
    assert load().settings.snapshot_dir == Path("/dev/shm/headway")
