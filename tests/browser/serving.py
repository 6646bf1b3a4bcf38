"""A dashboard in a process of its own, a service that lives, and a page that is visited."""

import json
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from browser.devtools import Browser
from fake_service import Service, Traffic, free_port, health


def wall_us() -> int:
    return time.time_ns() // 1000


@contextmanager
def dashboard(endpoints: Sequence[str], sites: Sequence[str] = ("local",), **options: Any) -> Iterator[str]:
    """Serve a page, and yield its address."""
    arguments = {"connect": list(endpoints), "sites": list(sites), "port": free_port()} | options
    start = f"from headway.dashboard.server import serve; serve(**{arguments!r})"
    process = subprocess.Popen([sys.executable, "-c", start], stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    assert "headway dashboard: http" in process.stderr.readline()
    try:
        yield f"http://127.0.0.1:{arguments['port']}"
    finally:
        process.terminate()
        _, complaints = process.communicate(timeout=20)
    assert complaints == ""


@contextmanager
def visit(browser: Browser, address: str) -> Iterator[Browser]:
    """Open a page, and see at the end that nothing was asked of others and nothing failed."""
    browser.requested.clear()
    browser.complaints.clear()
    browser.goto(address)
    yield browser
    origin = "/".join(address.split("/")[:3])
    assert browser.complaints == []
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


def live(page: Browser) -> None:
    page.until("document.getElementById('line').dataset.state === 'up'", within_s=20)


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
