"""What an operator must see within seconds: whether the road can be trusted, which car cannot, why and since when."""

import csv
import json
import os
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest
from browser.devtools import Browser, chromium
from browser.serving import alerts, alive, click, dashboard, fill, live, text, texts, visit, wall_us
from fake_service import Traffic, event, free_port, service
from sim.until import until

from headway.edge.storage.journal import EventUpdate, Journal
from headway_schemas import Event, Kind, Phase, Sensor
from headway_schemas.event import Deviation

pytestmark = pytest.mark.browser

S = 1_000_000
STATUS = "document.getElementById('status').dataset.state"
HIGHLIGHTED = "document.querySelector('#alerts [aria-current=true]')?.dataset.event"
SHOWN = "document.getElementById('evidence').dataset.event"
PICTURES = "[...document.querySelectorAll('#plots canvas')].map((drawn) => drawn.toDataURL())"
CENTRED = "document.getElementById('road').dataset.centred"
ROWS = "document.querySelectorAll('#vehicles [data-vehicle]').length"


def deviating(n: int, metres: float, phase: Phase = Phase.ONSET, **changes: object) -> Event:
    """Return an update of event `n` with a largest deviation until now."""
    made = event(n, phase, kind=Kind.BIAS, sensor=Sensor.LOCATION, t_us=wall_us())
    return made.model_copy(update={"deviation": Deviation(x_m=metres, v_mps=0.0)} | changes)


def test_a_clean_road_is_ok(page: Browser, endpoint: str) -> None:
    with service(endpoint) as running, alive(running, Traffic(50)):
        live(page)
        assert page.run(text("status")) == "Road OK"
        assert page.run(STATUS) == "ok"


@contextmanager
def two_sites(browser: Browser, vehicles: int, **traffic: Any) -> Iterator[tuple[Browser, dict[str, threading.Event]]]:
    """Show two sites, and yield the page and what ends each site's reports."""
    endpoints = {site: f"tcp/127.0.0.1:{free_port()}" for site in ("rsu-north", "rsu-south")}
    with (
        dashboard(list(endpoints.values()), list(endpoints)) as origin,
        visit(browser, f"{origin}/") as page,
        ExitStack() as services,
    ):
        ends = {}
        for site, endpoint in endpoints.items():
            running = services.enter_context(service(endpoint, site=site))
            ends[site] = services.enter_context(alive(running, Traffic(vehicles, site=site, **traffic)))
            running.publish(deviating(4, 0.8, site=site), deviating(4, 0.8, Phase.CLEARED, site=site))
        live(page)
        yield page, ends


def test_a_silent_site_is_named_and_leaves_the_figures(browser: Browser) -> None:
    with two_sites(browser, 30) as (page, ends):
        page.until(f"{text('tile-vehicles')}.includes('60')")
        ends["rsu-north"].set()
        page.until(f"{STATUS} === 'blind' && {text('status')}.includes('BLIND: rsu-north silent for')", within_s=6)
        assert page.run("document.getElementById('line').dataset.state") == "down"
        assert "rsu-north silent" in page.run(text("line"))
        page.until(f"/Vehicles30/.test({text('tile-vehicles')})", within_s=2)
        assert page.run("document.getElementById('road').getAttribute('aria-label')").startswith("30 vehicles")


def test_of_a_silent_site_no_event_is_said_to_be_open_and_no_car_is_kept_in_the_middle(
    page: Browser, endpoint: str
) -> None:
    with service(endpoint) as running, alive(running, Traffic(30)) as ended:
        live(page)
        running.publish(deviating(3, 1.0))
        page.until(f"{ROWS} === 1")
        assert texts(page, "#vehicles .state") == ["open · local"]
        click(page, "#vehicles [data-vehicle]")
        page.until(f"{CENTRED} === 'local/veh-0003'")
        ended.set()
        page.until(f"{STATUS} === 'blind' && {CENTRED} === ''", within_s=8)
        assert texts(page, "#vehicles .state") == ["not known · local"]
        assert page.run("document.querySelector('#alerts [data-event]').dataset.state") == "not known"


def test_a_dead_dashboard_leaves_nothing_bright(browser: Browser, endpoint: str) -> None:
    with service(endpoint) as running, alive(running, Traffic(30)):
        with dashboard([endpoint]) as origin:
            browser.goto(f"{origin}/")
            live(browser)
        browser.until("document.body.dataset.stale === 'true'", within_s=6)
        assert browser.run("getComputedStyle(document.querySelector('main')).filter") == "grayscale(1)"
        assert "BLIND: no contact with the dashboard" in browser.run(text("status"))
    browser.goto("about:blank")


def test_one_faulty_car_is_one_row_with_its_count(page: Browser, endpoint: str) -> None:
    with service(endpoint) as running, alive(running, Traffic(50)):
        live(page)
        for n in range(100):
            phase = Phase.CLEARED if n % 10 == 9 else Phase.UPDATE if n % 10 else Phase.ONSET
            made = deviating(n // 10, 1.0 + n / 10, phase, suspect="veh-0007", follower="veh-0007")
            running.publish(made.model_copy(update={"detected_us": made.detected_us - (100 - n) * S}))
        page.until(f"{text('vehicles')}.includes('10 events')")
        assert page.run(ROWS) == 1
        assert "worst 10.9 m" in page.run(text("vehicles"))
        assert page.run(text("status")) == "Road OK"


def test_every_car_faulty_is_a_row_each_worst_first_and_nothing_is_cut_silently(page: Browser, endpoint: str) -> None:
    with service(endpoint) as running, alive(running, Traffic(50)):
        live(page)
        running.publish(*(deviating(n, (n * 7) % 50 + 1.0) for n in range(50)))
        page.until(f"{ROWS} === 50")
        metres = [float(shown.split()[1]) for shown in texts(page, "#vehicles .worst")]
        assert metres == sorted(metres, reverse=True)
        assert metres[0] == 50.0
        page.until(f"{text('status')} === '50 cars not to be trusted'")
        running.publish(*(deviating(n, 0.5) for n in range(50, 120)))
        page.until("document.getElementById('vehicles-more').textContent === 'Show 50 of 70 more'")
        assert page.run(ROWS) == 50
        assert page.run("document.getElementById('alerts-more').hidden") is False
        click(page, "#vehicles-more")
        page.until(f"{ROWS} === 100")


def listed_in_the_terminal(events: list[Event], journal: Path) -> dict[str, tuple[str, ...]]:
    """Return kind, sensor and suspect of each event as `headway alerts list` has them."""
    stored = [EventUpdate(made, "", made.model_dump_json().encode()) for made in events]
    Journal(journal, site="local", instance="rsu-1", days=30.0, megabytes=100.0).write(stored)
    command = [sys.executable, "-m", "headway", "alerts", "list", "--json", "--limit=1000", f"--journal={journal}"]
    listed = json.loads(subprocess.run(command, capture_output=True, check=True).stdout)["alerts"]
    return {row["event_id"]: (row["kind"], row["sensor"], row["suspect"]) for row in listed}


def test_list_history_and_evidence_agree_about_every_event(page: Browser, endpoint: str, tmp_path: Path) -> None:
    kinds, sensors = [Kind.DRIFT, Kind.NOISE, Kind.BIAS], [Sensor.SPEED, Sensor.LOCATION, Sensor.BOTH]
    with service(endpoint) as running, alive(running, Traffic(120)):
        live(page)
        last = {}
        for n in range(100):
            onset = event(n, kind=Kind.UNKNOWN, sensor=Sensor.LOCATION, t_us=wall_us() - 9 * S)
            suspect = f"veh-{n + 1:04d}" if n % 4 == 0 else onset.suspect
            change = {"kind": kinds[n % 3], "sensor": sensors[n % 2], "suspect": suspect, "detected_us": wall_us()}
            last[onset.event_id] = onset.model_copy(update=change | {"phase": Phase.CLEARED if n % 2 else Phase.UPDATE})
            running.publish(onset, last[onset.event_id])
        page.until("document.querySelectorAll('#alerts [data-event]').length === 80")
        click(page, "#alerts-more")
        page.until("document.querySelectorAll('#history tr').length === 100")
        click(page, "#range button")
        page.until("document.querySelectorAll('#history tr').length === 100")
        listed, past = texts(page, "#alerts .alert"), texts(page, "#history tr")
        stated = {name: (update.kind, update.sensor, update.suspect) for name, update in last.items()}
        assert listed_in_the_terminal(running.journal, tmp_path / "journal.sqlite") == stated
        word = {Sensor.LOCATION: "position", Sensor.SPEED: "speed"}
        for name, shown in zip(alerts(page), listed, strict=True):
            kind, sensor, suspect = stated[name]
            assert shown.startswith(f"{kind}{suspect}")
            assert f"{word[sensor]}, " in shown
        counted = Counter(f"{kind}{word[sensor]}{suspect}" for kind, sensor, suspect in stated.values())
        assert Counter(next(key for key in counted if key in shown) for shown in past) == counted
        for name, (kind, sensor, suspect) in stated.items():
            click(page, f"#alerts [data-event='{name}']")
            page.until(f"{SHOWN} === '{name}'")
            assert page.run(text("evidence-of")).startswith(f"{suspect} · {kind}, {word[sensor]}")
            assert f"{suspect} behind {suspect}" not in page.run("document.body.textContent")


def test_in_a_flood_the_evidence_stays_and_is_that_of_the_highlighted_row(page: Browser, endpoint: str) -> None:
    with service(endpoint) as running, alive(running, Traffic(50)):
        live(page)
        onset = deviating(1, 0.5)
        running.publish(onset)
        page.until("document.querySelectorAll('#alerts [data-event]').length === 1")
        assert page.run(SHOWN) == ""
        click(page, "#alerts [data-event]")
        page.until("document.querySelectorAll('#plots .uplot').length === 3")
        page.until(f"document.getElementById('evidence').dataset.explained === '{onset.event_id}'", within_s=60)
        plots = page.run(PICTURES)
        for n in range(60):  # 30 s, six events a second
            running.publish(*(deviating(n % 40 + 2 + 40 * k, 1.0) for k in range(3)))
            assert page.run(HIGHLIGHTED) == page.run(SHOWN) == onset.event_id
            time.sleep(0.5)
        assert page.run(PICTURES) == plots
        running.publish(*(deviating(1, 0.8, Phase.UPDATE, detected_us=wall_us() + n) for n in range(3)))
        page.until(f"{text('fresh')} === '3 new'")
        assert page.run(PICTURES) == plots
        page.until(f"{text('verdict')}.includes('0.80 m further ahead')")
        click(page, "#fresh")
        page.until("document.getElementById('fresh').hidden")
        fill(page, "vehicle", "veh-0030")
        page.until(f"{SHOWN} === ''")
        assert page.run("document.querySelectorAll('#plots .uplot').length") == 0


def test_certainty_and_kind_do_not_contradict_and_no_negative_number_is_on_a_log_axis(
    page: Browser, endpoint: str
) -> None:
    latency = {"wire": -30_000, "queue": 300, "decode": 100, "detect": 700}
    with service(endpoint) as running, alive(running, Traffic(20)):
        live(page)
        made = deviating(1, 0.8, confidence=0.1, p_value=1e-15, gate=-0.03, statistic=23.0)
        running.publish(Event.model_validate(made.model_dump() | {"latency_us": latency}, strict=False))
        page.until("document.querySelectorAll('#vehicles [data-vehicle]').length === 1")
        click(page, "#vehicles [data-vehicle]")
        page.until("document.querySelectorAll('#plots .uplot').length === 3")
        verdict = page.run(text("verdict"))
        assert verdict.startswith(
            "veh-0001 says it is 0.80 m further ahead than it can be. Constant offset in position"
        )
        assert verdict.endswith("Nearly certain that something is wrong; the kind is not certain yet.")
        assert page.run("document.querySelector('#plots figure:last-child').dataset.scale") == "linear"
        assert "10 % for bias in position" in page.run(text("facts"))
        assert "clock of the sender ahead by 30 ms, queue 0.3 ms" in page.run(text("facts"))
        assert "since" in page.run(text("tile-rejected"))


def test_filters_reach_tiles_legend_and_road(page: Browser, endpoint: str) -> None:
    with service(endpoint) as running, alive(running, Traffic(40, anomalous={3})):
        live(page)
        running.publish(deviating(3, 1.0))
        page.until(f"{ROWS} === 1")
        fill(page, "vehicle", "veh-001")
        page.until(f"/Vehicles10/.test({text('tile-vehicles')})")
        assert page.run("document.getElementById('road').getAttribute('aria-label')").startswith("10 vehicles")
        assert page.run(ROWS) == 0
        assert "anomalous 0" in page.run(text("legend"))


def test_a_vehicle_opens_to_its_events(page: Browser, endpoint: str) -> None:
    with service(endpoint) as running, alive(running, Traffic(40)):
        live(page)
        for n, suspect in enumerate(("veh-0001", "veh-0002", "veh-0001")):
            running.publish(deviating(n, 1.0 + n, suspect=suspect, follower=suspect))
        page.until("document.querySelectorAll('#alerts [data-event]').length === 3")
        click(page, "#vehicles [data-vehicle=veh-0002]")
        page.until("document.querySelectorAll('#alerts [data-event]').length === 1")
        assert page.run(SHOWN) == page.run(HIGHLIGHTED) == "veh-0001-1"
        click(page, "#all")
        page.until("document.querySelectorAll('#alerts [data-event]').length === 3")


def test_pictures_of_what_an_operator_sees(browser: Browser, tmp_path: Path) -> None:
    """Draw a page of two sites, one silent; HEADWAY_SCREENSHOTS names a folder to keep it in."""
    folder = Path(os.environ.get("HEADWAY_SCREENSHOTS", tmp_path))
    with two_sites(browser, 30, anomalous={4}) as (page, ends):
        ends["rsu-north"].set()
        page.until(f"{STATUS} === 'blind'")
        page.until("document.querySelectorAll('#vehicles [data-vehicle]').length === 2")
        click(page, "#vehicles [data-vehicle]")
        page.until("document.querySelectorAll('#plots .uplot').length === 3")
        page.screenshot(folder / "blind.png")
    assert (folder / "blind.png").stat().st_size > 10_000


def test_a_mute_in_one_browser_is_seen_in_another(page: Browser, origin: str, endpoint: str, tmp_path: Path) -> None:
    with service(endpoint) as running, alive(running, Traffic(40)):
        live(page)
        running.publish(deviating(3, 1.0), deviating(5, 2.0))
        page.until(f"{ROWS} === 2")
        click(page, "#vehicles [data-vehicle=veh-0005]")
        page.until("!document.getElementById('handling').hidden")
        page.run("document.getElementById('handling').elements.by.value = 'anna'")
        page.run("document.getElementById('handling').elements.note.value = 'test drive'")
        click(page, "#handling [value=mute-1h]")
        page.until(f"{text('handling-note')} === 'Stored.'")
        with chromium(tmp_path / "another") as other, visit(other, f"{origin}/") as seen:
            seen.until(f"{text('status')} === '1 car not to be trusted · 1 car muted'")
            assert texts(seen, "#vehicles .who") == ["veh-0003", "veh-0005"]
            assert "by anna: test drive" in seen.run(text("vehicles"))
        click(page, "#handling [value=unmute]")
        page.until(f"{text('status')} === '2 cars not to be trusted'")
        click(page, "#handling [value=resolve]")
        page.until(f"{text('handling-state')} === 'Resolved by anna'")
        running.publish(deviating(6, 1.5, suspect="veh-0005", follower="veh-0005"))
        page.until(f"{text('handling-state')} === ''")
    assert [one.action for one in running.handled] == ["mute", "unmute", "resolve"]


def test_a_copied_link_opens_the_same_car_event_and_filter_in_a_fresh_profile(
    page: Browser, origin: str, endpoint: str, tmp_path: Path
) -> None:
    with service(endpoint) as running, alive(running, Traffic(40)):
        live(page)
        running.publish(*(deviating(n, 1.0, suspect=f"veh-000{n % 2}", follower=f"veh-000{n % 2}") for n in range(6)))
        page.until(f"{ROWS} === 2")
        fill(page, "vehicle", "veh-00")
        click(page, "#vehicles [data-vehicle=veh-0001]")
        page.until("document.querySelectorAll('#alerts [data-event]').length === 3")
        click(page, "#alerts li:last-child button")
        link, shown, listed = page.run("location.href"), page.run(SHOWN), alerts(page)
        with chromium(tmp_path / "fresh") as other, visit(other, link) as fresh:
            fresh.until(f"{SHOWN} === '{shown}'")
            fresh.until("document.querySelectorAll('#plots .uplot').length === 3")
            assert alerts(fresh) == listed
            assert fresh.run("document.getElementById('filter').elements.vehicle.value") == "veh-00"
            assert fresh.run(HIGHLIGHTED) == shown
            fresh.until("document.querySelectorAll('#history tr').length === 6")


def test_a_file_has_the_rows_that_are_shown(page: Browser, endpoint: str, tmp_path: Path) -> None:
    page.call("Browser.setDownloadBehavior", behavior="allow", downloadPath=str(tmp_path), eventsEnabled=False)
    with service(endpoint) as running, alive(running, Traffic(40)):
        live(page)
        running.publish(*(deviating(n, 1.0 + n) for n in range(90)))
        page.until(f"{ROWS} === 50")
        page.until("document.querySelectorAll('#history tr').length === 90")
        for name, rows in (("vehicles", "#vehicles li"), ("alerts", "#alerts li"), ("history", "#history tr")):
            click(page, f"#{name}-csv")
            file = tmp_path / f"{name}.csv"
            until(file.exists)
            with file.open(newline="") as lines:
                read = list(csv.DictReader(lines))
            assert len(read) == page.run(f"document.querySelectorAll('{rows}').length")
            click(page, f"#{name}-json")
            until((tmp_path / f"{name}.json").exists)
            as_json = json.loads((tmp_path / f"{name}.json").read_text())
            assert [set(row) for row in as_json] == [set(read[0])] * len(read)
        assert read[0]["suspect"] == "veh-0089"
        assert float(read[0]["deviation_m"]) == 90.0


def test_the_browser_notifies_of_a_car_that_becomes_faulty_if_asked(page: Browser, endpoint: str, origin: str) -> None:
    page.call("Browser.grantPermissions", origin=origin, permissions=["notifications"])
    with service(endpoint) as running, alive(running, Traffic(40)):
        live(page)
        running.publish(deviating(1, 1.0))
        page.until(f"{ROWS} === 1")
        page.run("window.shown = []; window.Notification = class { static permission = 'granted';"
                 " static requestPermission() { return Promise.resolve('granted'); }"
                 " constructor(title, { body }) { window.shown.push(`${title}: ${body}`); } }; 0")  # fmt: skip
        click(page, "#notify")
        page.until("document.getElementById('notify').getAttribute('aria-pressed') === 'true'")
        running.publish(deviating(2, 0.8), deviating(2, 0.9, Phase.UPDATE))
        page.until("window.shown.length === 1 && document.title === '(2) headway'")
        assert page.run("window.shown[0]").startswith("veh-0002 at local: Says it is 0.")
        page.run("localStorage.removeItem('notify')")
