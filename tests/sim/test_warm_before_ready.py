"""No message waits for a compiler: what the loop needs is compiled before the service reports ready."""

import subprocess
import sys
from pathlib import Path


def test_nothing_is_compiled_once_messages_flow() -> None:
    script = Path(__file__).with_name("warm_run.py")
    ended = subprocess.run([sys.executable, str(script)], check=False, stderr=subprocess.PIPE, text=True, timeout=600)
    assert (ended.returncode, ended.stderr) == (0, "")
