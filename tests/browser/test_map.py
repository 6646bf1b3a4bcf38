"""The map: loaded when it is opened, from the dashboard only; a click centres; a canvas where there is no WebGL."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from browser.devtools import Browser, chromium
from browser.serving import alive, click, dashboard, live, text, texts, visit
from browser.test_operator import deviating
from browser.test_page import FRAME_TIMES, busy_ms, print_figures
from dashboard.archives import raster_archive
from fake_service import Traffic, free_port, service
from matplotlib.image import imread

pytestmark = pytest.mark.browser

SOFTWARE_WEBGL = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")
OPEN = "document.getElementById('road').dataset.map === 'true'"
CENTRED = "document.getElementById('road').dataset.centred"
BOX = "document.getElementById('road').getBoundingClientRect()"
MAGENTA = (255, 0, 255)


@pytest.fixture(scope="module")
def webgl(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with chromium(tmp_path_factory.mktemp("webgl"), *SOFTWARE_WEBGL) as opened:
        yield opened


@contextmanager
def a_thousand(browser: Browser, endpoint: str, *options: str) -> Iterator[Browser]:
    """Show a thousand vehicles at 10 Hz, two of them with events."""
    with (
        service(endpoint) as running,
        alive(running, Traffic(1_000, anomalous={31}), rate_hz=10),
        dashboard([endpoint], ("local",), *options) as origin,
        visit(browser, f"{origin}/") as page,
    ):
        live(page)
        running.publish(deviating(31, 5.0), deviating(700, 2.0))
        page.until("document.querySelectorAll('#vehicles [data-vehicle]').length === 2")
        assert not any("maplibre" in asked for asked in page.requested)
        yield page


def centre_each(page: Browser, capsys: pytest.CaptureFixture[str], name: str) -> None:
    """Click on both, each of which is in the middle within a second, and measure frames with the second there."""
    took_s = []
    for n in (31, 700):
        before_s = time.monotonic()
        click(page, f"#vehicles [data-vehicle=veh-{n:04d}]")
        page.until(f"{CENTRED} === 'local/veh-{n:04d}'", within_s=1)
        took_s.append(time.monotonic() - before_s)
    page.call("Performance.enable", timeDomain="threadTicks")
    before_ms = busy_ms(page)
    figures = page.run(FRAME_TIMES)
    figures["main thread's CPU"] = (busy_ms(page) - before_ms) / 300
    print_figures(capsys, f"{name}, centred on a car among 1,000 at 10 Hz, frame times in ms", figures)
    print_figures(capsys, "a click centres, ms", {"slowest": 1000 * max(took_s)})
    assert figures["main thread's CPU"] < 12


def test_a_click_centres_the_car_on_the_basemap_within_a_second_among_a_thousand(
    webgl: Browser, endpoint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    archive = raster_archive(tmp_path / "town.pmtiles", MAGENTA, zooms=range(6))
    with a_thousand(webgl, endpoint, f"--basemap={archive}") as page:
        click(page, "#map")
        page.until(OPEN, within_s=20)
        centre_each(page, capsys, "a basemap drawn by the processor")
        click(page, "#map")
        page.until(f"!({OPEN})")


def test_where_no_graphics_card_draws_the_map_without_a_basemap_is_the_canvas(
    webgl: Browser, endpoint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with a_thousand(webgl, endpoint) as page:
        click(page, "#map")
        page.until(f"{text('attribution')}.startsWith('No graphics card')")
        assert page.run(OPEN) is False
        assert not any("maplibre" in asked for asked in page.requested)
        centre_each(page, capsys, "the map asked for, and the canvas taken")


def test_a_basemap_is_drawn_below_the_road(webgl: Browser, endpoint: str, tmp_path: Path) -> None:
    archive = raster_archive(tmp_path / "town.pmtiles", MAGENTA, zooms=range(6))
    options = f"--basemap={archive}"
    with (
        service(endpoint) as running,
        alive(running, Traffic(30)),
        dashboard([endpoint], ("local",), options) as origin,
        visit(webgl, f"{origin}/") as page,
    ):
        live(page)
        click(page, "#map")
        page.until(OPEN, within_s=20)
        page.until(f"{text('attribution')} === 'drawn for a test'")
        box = page.run(f"(({{x, y, width, height}}) => [x, y, width, height])({BOX})")
        deadline = time.monotonic() + 20
        while True:
            page.screenshot(tmp_path / "map.png")
            shown = imread(tmp_path / "map.png")
            x, y, width, height = map(int, box)
            road = (255 * shown[y : min(y + height, len(shown)), x : x + width, :3]).round().astype(int)
            if (abs(road - MAGENTA).max(axis=2) < 8).mean() > 0.5:
                break
            assert time.monotonic() < deadline, "the basemap is not drawn"
            time.sleep(0.2)
        click(page, "#theme")
        page.until("document.getElementById('map').getAttribute('aria-pressed') === 'true'")


def test_without_webgl_the_road_is_on_the_canvas(origin: str, endpoint: str, tmp_path: Path) -> None:
    with (
        service(endpoint) as running,
        alive(running, Traffic(30)),
        chromium(tmp_path / "profile", "--disable-3d-apis") as browser,
        visit(browser, f"{origin}/") as page,
    ):
        live(page)
        running.publish(deviating(3, 1.0))
        page.until("document.querySelectorAll('#vehicles [data-vehicle]').length === 1")
        click(page, "#map")
        page.until(f"{text('attribution')}.startsWith('No WebGL')")
        assert page.run(OPEN) is False
        assert not any("maplibre" in asked for asked in page.requested)
        click(page, "#vehicles [data-vehicle]")
        page.until(f"{CENTRED} === 'local/veh-0003'", within_s=1)
        assert page.run("document.getElementById('road').getBoundingClientRect().height") > 200


def test_sites_far_apart_are_shown_one_at_a_time(browser: Browser) -> None:
    endpoints = {site: f"tcp/127.0.0.1:{free_port()}" for site in ("east", "west")}
    with (
        dashboard(list(endpoints.values()), list(endpoints)) as origin,
        service(endpoints["east"], site="east") as east,
        service(endpoints["west"], site="west") as west,
        alive(east, Traffic(20, site="east")),
        alive(west, Traffic(20, site="west", shift_m=40_000.0)),
        visit(browser, f"{origin}/") as page,
    ):
        live(page)
        page.until("document.getElementById('road').getAttribute('aria-label').startsWith('40 vehicles')")
        page.until("document.getElementById('road').dataset.site !== ''")
        assert texts(page, "#road-sites button") == ["all sites", "east", "west"]
        for site in ("west", "", "east"):
            click(page, f"#road-sites [data-site='{site}']")
            page.until(f"document.getElementById('road').dataset.site === '{site}'")
        west.publish(deviating(3, 1.0, site="west"))
        page.until("document.querySelectorAll('#vehicles [data-vehicle]').length === 1")
        click(page, "#vehicles [data-vehicle]")
        page.until("document.getElementById('road').dataset.site === 'west'")
