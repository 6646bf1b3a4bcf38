"""The image, built once; these tests run only when asked for by their mark."""

import pytest
from engine.container import IMAGE, build


def pytest_ignore_collect(config: pytest.Config) -> bool | None:
    return None if config.option.markexpr == "engine" else True


@pytest.fixture(scope="session")
def image(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The image of this source."""
    build(tmp_path_factory.mktemp("build"))
    return IMAGE
