"""The unit: understood by systemd where there is one, confined, and of one mind with the settings."""

import configparser
import shutil
import subprocess
from collections import defaultdict
from pathlib import Path

import pytest
from deploy.manifest import ROOT, parse_command, settings_of

from headway.settings import Settings

UNIT = ROOT / "deploy" / "systemd" / "headway.service"
with_systemd = pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")


def options() -> dict[str, list[str]]:
    found = defaultdict(list)
    for line in UNIT.read_text().splitlines():
        name, equals, value = line.partition("=")
        if equals and not line.startswith("#"):
            found[name].append(value)
    return found


def analyze(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["systemd-analyze", *arguments], capture_output=True, text=True, check=False, timeout=30)


@with_systemd
def test_systemd_understands_every_line(tmp_path: Path) -> None:
    copy = tmp_path / UNIT.name
    copy.write_text(UNIT.read_text().replace("/opt/headway/bin/headway", shutil.which("true") or "/bin/true"))
    result = analyze("verify", "--man=no", copy)
    assert (result.returncode, result.stderr) == (0, "")


@with_systemd
def test_systemd_finds_little_exposed(tmp_path: Path) -> None:
    result = analyze("security", "--offline=yes", "--threshold=20", UNIT)
    assert result.returncode == 0, result.stdout


def test_the_unit_is_one_of_three_sections() -> None:
    parser = configparser.ConfigParser(strict=False, interpolation=None)
    parser.read(UNIT)
    assert parser.sections() == ["Unit", "Service", "Install"]


def test_the_unit_is_confined() -> None:
    said = options()
    for name in ("DynamicUser", "NoNewPrivileges", "PrivateTmp", "PrivateDevices", "ProtectHome", "RestrictNamespaces"):
        assert said[name] == ["yes"]
    assert said["ProtectSystem"] == ["strict"]
    assert said["CapabilityBoundingSet"] == [""]


def test_the_unit_runs_what_the_command_line_knows(monkeypatch: pytest.MonkeyPatch) -> None:
    said = options()
    for line in (*said["ExecStartPre"], *said["ExecStart"]):
        program, *arguments = line.split()
        assert program == "/opt/headway/bin/headway"
        parse_command(arguments)
    environment = dict(word.split("=", 1) for line in said["Environment"] for word in line.split())
    settings_of(environment, monkeypatch)


def test_the_unit_gives_the_service_time_to_stop() -> None:
    [timeout] = options()["TimeoutStopSec"]
    assert float(timeout) > Settings().stop_timeout_s
