"""The image on a container engine: built, started as it is deployed, fed, asked for its health, and stopped."""

import urllib.request
from collections.abc import Iterator

import pytest
from engine.container import BASE, engine, inspected, run
from sim.loopback import free_endpoint
from sim.until import until

pytestmark = pytest.mark.engine

MEGABYTE = 1 << 20
READY_S = 120.0


@pytest.fixture
def service(image: str) -> Iterator[str]:
    settings = {"HEADWAY_LISTEN": free_endpoint(), "HEADWAY_SITE": "local"}
    engine("rm", "--force", "headway-test", check=False)
    run("headway-test", "serve", environment=settings, detach=True)
    yield settings["HEADWAY_LISTEN"]
    engine("rm", "--force", "headway-test")


def page(path: str) -> str:
    """Return a page of the service, nothing while it has none."""
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:9464{path}", timeout=2.0) as answer:
            return str(answer.read().decode())
    except OSError:
        return ""


def test_the_image_is_small(image: str) -> None:
    size_mb = (inspected("image", image)["Size"] - inspected("image", BASE)["Size"]) / MEGABYTE
    print(f"image without its base: {size_mb:.0f} MB")
    assert size_mb <= 350


def test_a_read_only_container_without_capabilities_judges_and_stops_in_order(service: str) -> None:
    until(lambda: page("/readyz") == "ok\n", READY_S)
    run("headway-replay", "replay", "synthetic:10", "--seconds=8", f"--connect={service}", environment={})
    metrics = page("/metrics")
    [scored] = [line for line in metrics.splitlines() if line.startswith('headway_records_total{outcome="scored"}')]
    assert float(scored.split()[-1]) > 0
    engine("exec", "headway-test", *inspected("container", "headway-test")["Config"]["Healthcheck"]["Test"][1:])
    engine("stop", "--time=30", "headway-test")
    state = inspected("container", "headway-test")["State"]
    assert (state["Status"], state["ExitCode"]) == ("exited", 0)
    assert "starting anew" not in engine("logs", "headway-test").stderr, "kernels of the image are used as they are"
