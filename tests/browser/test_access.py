"""The page without a mouse, on a phone, and for a screen reader."""

from collections.abc import Iterator
from importlib.resources import files

import pytest
from browser.devtools import Browser
from browser.serving import alive, click, live, text, wall_us
from fake_service import Service, Traffic, event, service

from headway_schemas import Kind, Phase, Sensor
from headway_schemas.event import Deviation

pytestmark = pytest.mark.browser

VIOLATIONS = """axe.run(document, {resultTypes: ["violations"]}).then(({violations}) => violations.map(
  ({id, nodes}) => [id, ...nodes.map(({html, failureSummary}) => `${html.slice(0, 200)} ${failureSummary}`)]))"""
SCREENS = {"desk": (1440, 1180), "phone": (390, 844)}


def size(page: Browser, width: int, height: int) -> None:
    page.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)


@pytest.fixture
def busy(page: Browser, endpoint: str) -> Iterator[tuple[Browser, Service]]:
    """The page with vehicles of every state and the evidence of one."""
    with service(endpoint) as running, alive(running, Traffic(60, anomalous={3})):
        live(page)
        for n, kind in enumerate((Kind.BIAS, Kind.NOISE, Kind.MISS, Kind.RESPONSE)):
            made = event(n, kind=kind, sensor=Sensor.LOCATION if n < 2 else Sensor.LINK, t_us=wall_us())
            running.publish(made.model_copy(update={"deviation": Deviation(x_m=n + 0.5, v_mps=0.1)}))
        running.publish(event(3, Phase.CLEARED, kind=Kind.RESPONSE, sensor=Sensor.LINK, t_us=wall_us()))
        page.until("document.querySelectorAll('#vehicles [data-vehicle]').length === 4")
        yield page, running
        size(page, *SCREENS["desk"])


def press(page: Browser, key: str) -> None:
    code = {"Enter": "\r"}.get(key, key)
    for kind in ("keyDown", "keyUp"):
        typed = {"text": code} if kind == "keyDown" else {}
        page.call("Input.dispatchKeyEvent", type=kind, key=key, windowsVirtualKeyCode=ord(code.upper()), **typed)


@pytest.mark.parametrize("screen", SCREENS)
@pytest.mark.parametrize("theme", ["dark", "light"])
def test_axe_finds_no_violation(busy: tuple[Browser, Service], screen: str, theme: str) -> None:
    page, _ = busy
    size(page, *SCREENS[screen])
    click(page, "#vehicles [data-vehicle]")
    page.until("document.querySelectorAll('#plots .uplot').length === 3")
    page.run("document.getElementById('details').open = true")
    page.until("document.querySelectorAll('#history tr').length === 4")
    if page.run("document.documentElement.dataset.theme") != theme:
        click(page, "#theme")
    page.run((files("axe_core_python") / "axe.min.js").read_text(encoding="utf-8") + "; 0")
    assert page.run(VIOLATIONS) == []


def test_on_a_phone_status_and_first_car_need_no_scrolling(busy: tuple[Browser, Service]) -> None:
    page, _ = busy
    size(page, *SCREENS["phone"])
    for selector in ("#status", "#vehicles li"):
        page.until(f"document.querySelector('{selector}').getBoundingClientRect().bottom <= innerHeight")
    assert page.run("document.documentElement.scrollWidth <= innerWidth")


def test_one_car_is_handled_by_the_keyboard_only(busy: tuple[Browser, Service]) -> None:
    page, running = busy
    page.run("localStorage.removeItem('by'); document.getElementById('handling').elements.by.value = ''; 0")
    for key in ("j", "j", "k", "Enter"):
        press(page, key)
    page.until("document.getElementById('evidence').dataset.event === 'veh-0001-1'")
    press(page, "a")
    page.until("document.activeElement.name === 'by'")
    for key in (*"anna", "Enter"):
        press(page, key)
    page.until(f"{text('handling-state')} === 'Acknowledged by anna'")
    page.run("document.activeElement.blur()")
    press(page, "m")
    page.until(f"{text('handling-state')}.startsWith('Muted until')")
    assert [one.action for one in running.handled] == ["acknowledge", "mute"]
    press(page, "/")
    page.until("document.activeElement.name === 'vehicle'")
    page.run("document.activeElement.blur()")
    press(page, "?")
    page.until("document.getElementById('help').open")
