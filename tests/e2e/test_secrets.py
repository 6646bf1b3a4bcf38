"""A password of the bus is nowhere to be read but in its own file."""

import json
import subprocess
import sys
from pathlib import Path

import httpx
from e2e.serving import without_headway
from sim.loopback import free_endpoint
from sim.until import until

SECRET = "correct-horse-battery"


def test_a_password_is_in_no_log_process_list_metric_or_printed_setting(tmp_path: Path) -> None:
    options = tmp_path / "zenoh.json5"
    account = {"user": "headway", "password": SECRET}
    options.write_text(json.dumps({"transport": {"auth": {"usrpwd": account}}}))
    unreachable = free_endpoint()
    more = {
        "HEADWAY_ZENOH_CONFIG": str(options), "HEADWAY_MODE": "client", "HEADWAY_CONNECT": unreachable,
        "HEADWAY_LISTEN": "", "HEADWAY_LOG_LEVEL": "debug",
    }  # fmt: skip
    shown = subprocess.run(
        [sys.executable, "-m", "headway", "config", "show"], env=without_headway() | more, capture_output=True,
        check=True, text=True,
    )  # fmt: skip
    service = _waiting(tmp_path, more)
    try:
        until(lambda: "no router yet" in _log(tmp_path), 300.0)
        read = [shown.stdout, shown.stderr, _log(tmp_path)]
        read += [Path(f"/proc/{service.pid}/{file}").read_bytes().decode() for file in ("cmdline", "environ")]
        port = next(line["http_port"] for line in map(json.loads, _log(tmp_path).splitlines()) if "http_port" in line)
        read += [httpx.get(f"http://127.0.0.1:{port}/{page}").text for page in ("metrics", "readyz", "livez")]
    finally:
        service.kill()
        service.wait(10.0)
    assert all(SECRET not in text for text in read)
    assert str(options) in shown.stdout


def _waiting(folder: Path, more: dict[str, str]) -> "subprocess.Popen[bytes]":
    """Start a service that waits for its router, at any free port for its metrics."""
    environment = without_headway() | {"HEADWAY_HTTP_PORT": "0", "HEADWAY_STATE_DIR": ""} | more
    with (folder / "log").open("wb") as log:
        return subprocess.Popen([sys.executable, "-m", "headway", "serve"], env=environment, stderr=log)


def _log(folder: Path) -> str:
    return (folder / "log").read_text(encoding="utf-8")
