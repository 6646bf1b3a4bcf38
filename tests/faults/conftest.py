"""Faults over real zenoh with real processes. Each test is a row of the table that is printed at the end."""

import pytest

_ROWS = pytest.StashKey[list[tuple[str, str, str]]]()


def pytest_configure(config: pytest.Config) -> None:
    config.stash[_ROWS] = []


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if item.path.parent.name == "faults":
            item.add_marker("faults")


@pytest.fixture
def measured(request: pytest.FixtureRequest):
    """Notes a row of the table: what was done, what came of it, what it must be."""

    def note(reason: str, got: str, must: str) -> None:
        request.config.stash[_ROWS].append((reason, got, must))

    return note


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    rows = config.stash[_ROWS]
    if not rows:
        return
    terminalreporter.section("faults")
    for reason, got, must in [("fault", "measured", "must be"), *rows]:
        terminalreporter.write_line(f"{reason:<60} {got:<50} {must}")
