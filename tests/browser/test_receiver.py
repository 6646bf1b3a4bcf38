"""What a receiver of notices gets of the vehicles that the page shows."""

import time

import httpx
import pytest
from browser.devtools import Browser
from browser.serving import alive, dashboard, live, receiver, text, visit, wall_us
from browser.test_operator import S, deviating
from fake_service import Traffic, service
from sim.until import until

from headway_schemas import Phase

pytestmark = pytest.mark.browser


def test_a_receiver_gets_one_post_at_the_onset_and_one_at_the_end_and_none_of_a_muted_car(
    browser: Browser, endpoint: str
) -> None:
    with (
        receiver() as (address, bodies),
        service(endpoint) as running,
        alive(running, Traffic(20)),
        dashboard([endpoint], ("local",), f"--webhook={address}", "--runbook-url=http://wiki/headway") as origin,
        visit(browser, f"{origin}/") as page,
    ):
        live(page)
        mute = {
            "site": "local",
            "vehicle": "veh-0005",
            "action": "mute",
            "by": "anna",
            "until_us": wall_us() + 3600 * S,
        }
        assert httpx.post(f"{origin}/handling", json=mute).status_code == 200
        time.sleep(1.0)
        for n in range(8):
            phase = Phase.UPDATE if n else Phase.ONSET
            running.publish(*(deviating(k, 1.0 + n, phase, suspect=f"veh-{k:04d}") for k in (3, 5)))
            time.sleep(0.3)
        assert [(body["status"], body["vehicle"]) for body in bodies] == [("firing", "veh-0003")]
        assert page.run(text("status")) == "1 car not to be trusted · 1 car muted"
        assert bodies[0]["runbook_url"] == "http://wiki/headway"
        running.publish(*(deviating(k, 9.0, Phase.CLEARED, suspect=f"veh-{k:04d}") for k in (3, 5)))
        until(lambda: len(bodies) == 2, deadline_s=25.0)
        time.sleep(3.0)
        assert [(body["status"], body["vehicle"]) for body in bodies] == [
            ("firing", "veh-0003"),
            ("resolved", "veh-0003"),
        ]
