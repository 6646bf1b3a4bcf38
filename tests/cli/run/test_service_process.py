"""What is done beside a service that runs as a child."""

import threading
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any

import pytest
from sim.until import until

from headway.cli.run.service_process import PREFIX, running_service, scraping
from headway.settings import load


def test_metrics_are_read_all_the_while_and_nobody_minds_when_they_are_not_there() -> None:
    asked: list[str] = []

    class Metrics(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            asked.append(self.path)
            self.send_response(200)
            self.end_headers()

        def log_message(self, *_: object) -> None:
            pass

    with HTTPServer(("127.0.0.1", 0), Metrics) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        url = f"http://127.0.0.1:{server.server_port}/metrics"
        with scraping(url, 0.01):
            until(lambda: len(asked) >= 3)
            server.shutdown()
    assert set(asked) == {"/metrics"}
    with scraping(url, 0.01):
        threading.Event().wait(0.05)


def test_a_service_has_the_settings_of_the_user_on_a_bus_of_its_own(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    started: dict[str, Any] = {}

    def start(command: list[str], env: dict[str, str], **_: object) -> None:
        started.update(command=command, env=env)
        raise OSError

    monkeypatch.setattr("subprocess.Popen", start)
    for name, value in {"MODEL": "aekf", "PREFIX": "city", "CONNECT": "tcp/elsewhere:1", "ZENOH_CONFIG": "x"}.items():
        monkeypatch.setenv(f"HEADWAY_{name}", value)
    with pytest.raises(OSError), running_service({"site": "demo"}, tmp_path / "headway.toml"):
        pass
    assert started["command"][-3:] == ["serve", "--config", str(tmp_path / "headway.toml")]
    for name, value in started["env"].items():
        monkeypatch.setenv(name, value)
    settings = load().settings
    assert (settings.model, settings.site, settings.prefix) == ("aekf", "demo", PREFIX)
    assert (settings.connect, settings.zenoh_config, settings.state_dir) == ((), None, None)
    assert settings.listen[0].startswith("tcp/127.0.0.1:")
