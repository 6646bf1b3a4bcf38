"""The command line itself: it starts at once."""

import subprocess
import sys

HEAVY = {"numba", "numpy", "polars", "pydantic", "rich", "scipy", "structlog", "zenoh"}


def test_the_command_line_is_read_without_any_library_of_the_commands() -> None:
    code = "import sys, headway.cli.app; print(*{name.partition('.')[0] for name in sys.modules})"
    ended = subprocess.run([sys.executable, "-c", code], check=True, stdout=subprocess.PIPE, text=True)
    assert not HEAVY & set(ended.stdout.split())
