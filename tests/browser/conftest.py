from collections.abc import Iterator

import pytest
from browser.devtools import Browser, chromium
from browser.serving import dashboard, visit
from fake_service import free_port


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with chromium(tmp_path_factory.mktemp("profile")) as opened:
        yield opened


@pytest.fixture
def endpoint() -> str:
    return f"tcp/127.0.0.1:{free_port()}"


@pytest.fixture
def origin(endpoint: str) -> Iterator[str]:
    """Address of a dashboard in a process of its own."""
    with dashboard([endpoint]) as address:
        yield address


@pytest.fixture
def page(browser: Browser, origin: str) -> Iterator[Browser]:
    with visit(browser, f"{origin}/") as opened:
        yield opened
