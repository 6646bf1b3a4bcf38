"""The unit under a systemd that boots a Debian: started, confined, killed, hung and stopped."""

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
from engine.container import engine
from engine.debian import ROOT, debian

pytestmark = pytest.mark.engine

BOOT_S = 1_800.0
"""The first start compiles the kernels."""
TRIAL = """[Service]
Type=exec
ExecStart=/usr/bin/python3 /result/unit_process.py
[Install]
WantedBy=multi-user.target
"""
SETTINGS = 'site = "local"\nmode = "peer"\nlisten = ["tcp/127.0.0.1:7447"]\n'


@pytest.fixture(scope="module")
def seen(image: str, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What `unit_process.py` saw in the machine."""
    if shutil.which("systemd-nspawn") is None:
        pytest.skip("needs systemd-nspawn (Debian: apt-get install systemd-container)")
    folder = tmp_path_factory.mktemp("unit")
    tree, result = folder / "machine", folder / "result"
    subprocess.run(["cp", "--archive", debian(), tree], check=True)
    install(image, tree)
    result.mkdir()
    shutil.copy(Path(__file__).with_name("unit_process.py"), result)
    boot = ["systemd-nspawn", "--boot", "--register=no", "--keep-unit", "--console=pipe", "--private-network"]
    ended = subprocess.run(
        [*boot, f"--directory={tree}", f"--bind={result}:/result"],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
        timeout=BOOT_S,
    )
    shutil.rmtree(tree)
    found = result / "result.json"
    assert found.exists(), ended.stdout[-3000:] + ended.stderr[-3000:]
    return dict(json.loads(found.read_text()))


def install(image: str, tree: Path) -> None:
    """Put the package of the image, the unit, its settings and its credentials where the documentation says."""
    engine("rm", "--force", "headway-copied", check=False)
    engine("create", "--name=headway-copied", image)
    engine("cp", "headway-copied:/opt/headway", str(tree / "opt"), timeout_s=600.0)
    engine("rm", "headway-copied")
    etc = tree / "etc"
    (etc / "headway" / "tls").mkdir(parents=True)
    (etc / "headway" / "headway.toml").write_text(SETTINGS)
    for name in ("ca.crt", "headway.crt", "headway.key"):
        file = etc / "headway" / "tls" / name
        file.write_text(f"of {name}")
        file.chmod(0o600)
    units = etc / "systemd" / "system"
    shutil.copy(ROOT / "deploy" / "systemd" / "headway.service", units)
    (units / "trial.service").write_text(TRIAL)
    wanted = units / "multi-user.target.wants"
    wanted.mkdir(exist_ok=True)
    (wanted / "trial.service").symlink_to("../trial.service")


def test_it_is_started_once_it_is_ready(seen: dict[str, Any]) -> None:
    assert "error" not in seen, seen
    _, unit = seen["started"]
    assert (unit["ActiveState"], unit["SubState"], unit["NRestarts"]) == ("active", "running", "0")
    assert seen["ready"] == "ok\n"


def test_it_runs_in_its_sandbox(seen: dict[str, Any]) -> None:
    status = seen["process"]["status"]
    assert status["Uid"].split()[0] != "0"
    assert (int(status["CapEff"], 16), int(status["CapBnd"], 16)) == (0, 0)
    assert (status["NoNewPrivs"], status["Seccomp"]) == ("1", "2")
    assert "ro" in seen["process"]["root"]


def test_it_alone_reads_its_credentials(seen: dict[str, Any]) -> None:
    key = seen["process"]["key"]
    assert key["text"] == "of headway.key"
    assert (str(key["uid"]), key["mode"]) == (seen["process"]["status"]["Uid"].split()[0], "0o400")


def test_it_judges_and_keeps_its_state(seen: dict[str, Any]) -> None:
    [scored] = [line for line in seen["metrics"] if 'outcome="scored"' in line]
    assert float(scored.split()[-1]) > 0
    assert "journal.sqlite" in seen["files"]


def test_it_is_started_again_after_a_kill_and_after_a_hang(seen: dict[str, Any]) -> None:
    print(f"active again {seen['restart_s']:.1f} s after a kill, {seen['watchdog_s']:.1f} s after a hang")
    assert seen["restart_s"] < 10.0
    assert seen["ready_again"] == "ok\n"
    assert 5.0 < seen["watchdog_s"] < 30.0
    assert "Watchdog timeout" in seen["journal"]


def test_it_stops_in_order(seen: dict[str, Any]) -> None:
    unit = seen["stopped"]
    assert (unit["ActiveState"], unit["Result"], unit["ExecMainStatus"]) == ("inactive", "success", "0")
