import os
from pathlib import Path

import pytest
from hypothesis import settings

import headway  # noqa: F401 - says where kernels are kept, which numba must know before it is imported
from headway.core.runtime import bound_kernel

ROOT = Path(__file__).resolve().parents[1]

bound_kernel.check_arguments = True

settings.register_profile("suite", deadline=None)
settings.load_profile("suite")
"""No test times anything: the first example of some compiles a kernel."""

os.environ["ZENOH_RUNTIME"] = "(rx: (worker_threads: 2))"
"""Tests hold both ends in one process, and one end that stalls must not keep the other from reading."""


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of real drives, beside the project (HEADWAY_TEST_DATA names another place)."""
    folder = Path(os.environ.get("HEADWAY_TEST_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"real drives not found at {folder}; set HEADWAY_TEST_DATA")
    return folder


@pytest.fixture(scope="session", autouse=True)
def _state_of_nobody(tmp_path_factory: pytest.TempPathFactory) -> None:
    """No test, nor any service that it starts, reads or writes what the user's own service keeps."""
    os.environ["XDG_STATE_HOME"] = str(tmp_path_factory.mktemp("state"))
    for name in ("STATE_DIRECTORY", "RUNTIME_DIRECTORY"):
        os.environ.pop(name, None)
