"""The page over a real service that real traffic passes for 100 s: one car of fifty has a faulty sensor."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from browser.devtools import Browser
from browser.serving import click, dashboard, live, text, texts, visit
from browser.test_operator import ROWS
from e2e.serving import KEYS, Service, without_headway

from headway.cli.run.recorded.refusals import Reading
from headway.cli.run.replay import Request, frames_of

pytestmark = pytest.mark.browser

SOURCE, INJECT, SEED, SECONDS = "synthetic:50", "c=25,p=0.02,share=0.02", 9, 200.0
WATCHED_S = 100.0


def faulty() -> str:
    """Return the one vehicle whose readings the replay falsifies."""
    frames, _ = frames_of(Request(Reading([SOURCE]), KEYS.site, 1.0, INJECT, SEED, SECONDS))
    [vehicle] = {label.vehicle for label in frames.labels}
    return vehicle


@contextmanager
def replay(endpoint: str) -> Iterator[None]:
    options = (f"--inject={INJECT}", f"--seed={SEED}", f"--seconds={SECONDS}", f"--site={KEYS.site}")
    command = [sys.executable, "-m", "headway", "replay", SOURCE, *options, f"--connect={endpoint}"]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL, env=without_headway()) as process:
        try:
            yield
        finally:
            process.terminate()


def stored(journal: Path) -> dict[str, dict]:
    """Return the newest update of each event, as `headway alerts list` has it."""
    command = [sys.executable, "-m", "headway", "alerts", "list", "--json", "--limit=1000", f"--journal={journal}"]
    listed = json.loads(subprocess.run(command, capture_output=True, check=True).stdout)["alerts"]
    return {row["event_id"]: row for row in listed}


def test_one_faulty_car_among_fifty_is_one_row_for_a_hundred_seconds(browser: Browser, tmp_path: Path) -> None:
    folder = Path(os.environ.get("HEADWAY_SCREENSHOTS", tmp_path))
    settings = {
        "HEADWAY_STATE_DIR": str(tmp_path / "state"),
        "HEADWAY_HEALTH_INTERVAL_S": "1",
        "HEADWAY_ALARM_BUDGET_PER_HOUR": "0.05",  # of the 49 others none alarms
    }
    running = Service(tmp_path / "service", settings)
    try:
        with (
            replay(running.endpoint),
            dashboard([running.endpoint], (KEYS.site,)) as origin,
            visit(browser, f"{origin}/") as page,
        ):
            live(page)
            page.until(f"{ROWS} === 1", within_s=60)
            seen, end_s = set(), time.monotonic() + WATCHED_S
            while time.monotonic() < end_s:
                seen.add(tuple(texts(page, "#vehicles .who")))
                time.sleep(0.5)
            assert seen == {(faulty(),)}
            journal = tmp_path / "state" / "journal.sqlite"
            deadline, events = time.monotonic() + 60.0, stored(journal)
            while (shown := counted(page)) != (kept := sum(row["count"] for row in events.values())):
                assert time.monotonic() < deadline, f"{shown} events on the page, {kept} in the journal"
                events = stored(journal)
            assert shown > 3
            assert {row["suspect"] for row in events.values()} == {faulty()}
            page.screenshot(folder / "live.png")
            click(page, "#vehicles [data-vehicle]")
            page.until("document.querySelectorAll('#plots .uplot').length === 3", within_s=20)
            page.until(f"{text('explained')} !== ''", within_s=60)
            page.screenshot(folder / "live-open.png")
    finally:
        running.kill()


def counted(page: Browser) -> int:
    """Return the number of events that the row states."""
    return int(texts(page, "#vehicles .since")[0].split()[0])
