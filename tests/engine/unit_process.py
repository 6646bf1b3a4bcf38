"""Runs in the machine that systemd booted: tries the unit, writes what it saw, and powers off."""

import json
import os
import signal
import subprocess
import time
import traceback
import urllib.request
from pathlib import Path
from typing import Any

RESULT = Path("/result/result.json")
UNIT = "headway.service"
BIN = "/opt/headway/bin/headway"
SHOWN = "ActiveState,SubState,MainPID,NRestarts,Result,ExecMainCode,ExecMainStatus,DynamicUser,NotifyAccess"


def systemctl(*arguments: str) -> str:
    return subprocess.run(["systemctl", *arguments], capture_output=True, text=True, check=False).stdout.strip()


def shown() -> dict[str, str]:
    return dict(line.split("=", 1) for line in systemctl("show", UNIT, f"--property={SHOWN}").splitlines())


def page(path: str) -> str:
    with urllib.request.urlopen(f"http://127.0.0.1:9464{path}", timeout=5.0) as answer:
        return str(answer.read().decode())


def restarted(count: int, within_s: float) -> float:
    """Return after how many seconds it was active again, with so many restarts."""
    since = time.monotonic()
    while time.monotonic() - since < within_s:
        now = shown()
        if (int(now["NRestarts"]), now["ActiveState"]) == (count, "active"):
            return time.monotonic() - since
        time.sleep(0.1)
    return float("inf")


def process(pid: str) -> dict[str, Any]:
    status = dict(
        line.split(":\t", 1) for line in Path(f"/proc/{pid}/status").read_text().splitlines() if ":\t" in line
    )
    key = Path(f"/proc/{pid}/root/run/credentials/{UNIT}/headway.key")
    mounts = [line.split() for line in Path(f"/proc/{pid}/mounts").read_text().splitlines()]
    return {
        "status": {name: status[name].strip() for name in ("Uid", "CapEff", "CapBnd", "NoNewPrivs", "Seccomp")},
        "key": {"text": key.read_text(), "uid": key.stat().st_uid, "mode": oct(key.stat().st_mode & 0o777)},
        "root": next(options for _, where, _, options, *_ in mounts if where == "/").split(","),
    }


def tried() -> dict[str, Any]:
    """Return what was seen: started, fed, killed, stopped by a signal that hangs it, and ended in order."""
    seen: dict[str, Any] = {"started": (systemctl("start", UNIT), shown())}
    seen["ready"] = page("/readyz")
    pid = seen["started"][1]["MainPID"]
    seen["process"] = process(pid)
    replay = [BIN, "replay", "synthetic:10", "--seconds=8", "--connect=tcp/127.0.0.1:7447"]
    subprocess.run(replay, check=True, capture_output=True)
    seen["metrics"] = [line for line in page("/metrics").splitlines() if line.startswith("headway_records_total")]
    seen["files"] = sorted(path.name for path in Path("/var/lib/private/headway").iterdir())
    os.kill(int(pid), signal.SIGKILL)
    seen["restart_s"] = restarted(1, 60.0)
    seen["ready_again"] = page("/readyz")
    os.kill(int(shown()["MainPID"]), signal.SIGSTOP)
    seen["watchdog_s"] = restarted(2, 90.0)
    seen["journal"] = subprocess.run(
        ["journalctl", "--unit", UNIT, "--output=cat", "--no-pager"], capture_output=True, text=True, check=False
    ).stdout
    systemctl("stop", UNIT)
    seen["stopped"] = shown()
    return seen


try:
    result: dict[str, Any] = tried()
except Exception:  # noqa: BLE001 - the test reads it
    result = {
        "error": traceback.format_exc(),
        "unit": shown(),
        "log": subprocess.getoutput(f"journalctl -u {UNIT} -n 60 --no-pager"),
    }
RESULT.write_text(json.dumps(result))
systemctl("poweroff")
