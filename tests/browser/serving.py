"""A dashboard in a process of its own, a service that lives, and a page that is visited."""

import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from browser.devtools import Browser
from fake_service import Service, Traffic, free_port, health


def wall_us() -> int:
    return time.time_ns() // 1000


@contextmanager
def dashboard(endpoints: Sequence[str], sites: Sequence[str] = ("local",), *options: str) -> Iterator[str]:
    """Serve a page by the command, and yield its address."""
    port = free_port()
    asked = [f"--connect={endpoint}" for endpoint in endpoints] + [f"--site={site}" for site in sites]
    command = [sys.executable, "-m", "headway", "dashboard", f"--port={port}", *asked, *options]
    environment = {name: value for name, value in os.environ.items() if not name.startswith("HEADWAY_")}
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment)
    assert process.stderr is not None
    first = process.stderr.readline()
    assert "headway dashboard: http" in first, first
    try:
        yield f"http://127.0.0.1:{port}"
    finally:
        process.terminate()
        _, complaints = process.communicate(timeout=20)
    # A service that starts later than the dashboard is no complaint.
    others = [line for line in complaints.splitlines() if "contact with" not in line and "connected to" not in line]
    assert others == [], others


@contextmanager
def visit(browser: Browser, address: str) -> Iterator[Browser]:
    """Open a page, and see at the end that nothing was asked of others and nothing failed."""
    browser.requested.clear()
    browser.complaints.clear()
    browser.goto(address)
    yield browser
    origin = "/".join(address.split("/")[:3])
    assert browser.complaints == [], browser.complaints
    own = (origin, "data:image/", f"blob:{origin}")
    assert [asked for asked in browser.requested if not asked.startswith(own)] == []
    browser.goto("about:blank")


@contextmanager
def alive(running: Service, traffic: Traffic, rate_hz: float = 2.0) -> Iterator[threading.Event]:
    """Publish the state of the traffic and the health of the service until the end, or until the event is set."""
    ended = threading.Event()
    instance = f"{running.keys.site}-1"

    def publish() -> None:
        started, refresh = time.monotonic(), 0
        while not ended.wait(max(0.0, started + refresh / rate_hz - time.monotonic())):
            elapsed_s = time.monotonic() - started
            running.publish(*traffic.states(elapsed_s, wall_us()))
            if refresh % max(1, int(rate_hz)) == 0:
                site, n = running.keys.site, traffic.vehicles
                running.publish(health(100 + elapsed_s, wall_us(), vehicles=n, site=site, instance=instance))
            refresh += 1

    thread = threading.Thread(target=publish)
    thread.start()
    try:
        yield ended
    finally:
        ended.set()
        thread.join()


@contextmanager
def receiver() -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Take webhooks; yield the address and the bodies that came."""
    bodies: list[dict[str, Any]] = []

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            bodies.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
            self.send_response(204)
            self.end_headers()

        def log_message(self, *_: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}/hook", bodies
        finally:
            server.shutdown()
            thread.join()


def live(page: Browser) -> None:
    """Wait until the services report; on a busy machine that may take a while."""
    page.until("document.getElementById('line').dataset.state === 'up'", within_s=60)


def text(name: str) -> str:
    return f"document.getElementById('{name}').textContent"


def texts(page: Browser, selector: str) -> list[str]:
    found: list[str] = page.run(
        f"[...document.querySelectorAll({json.dumps(selector)})].map((node) => node.textContent)"
    )
    return found


def alerts(page: Browser) -> list[str]:
    shown: list[str] = page.run(
        "[...document.querySelectorAll('#alerts [data-event]')].map((row) => row.dataset.event)"
    )
    return shown


def click(page: Browser, selector: str) -> None:
    page.run(f"document.querySelector({json.dumps(selector)}).click()")


def fill(page: Browser, name: str, value: str) -> None:
    """Fill in a field of the filter as a person does."""
    events = "".join(f" f.dispatchEvent(new Event('{kind}', {{ bubbles: true }}));" for kind in ("input", "change"))
    page.run(f"{{const f = document.getElementById('filter').elements.{name}; f.value = {json.dumps(value)};{events}}}")
