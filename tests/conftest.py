import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of real drives, beside the project (HEADWAY_TEST_DATA names another place)."""
    folder = Path(os.environ.get("HEADWAY_TEST_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"real drives not found at {folder}; set HEADWAY_TEST_DATA")
    return folder
