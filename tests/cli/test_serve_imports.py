"""What `headway serve` imports: nothing heavy, and nothing that another command needs."""

import subprocess
import sys

HEAVY = {
    "asn1tools", "confluent_kafka", "headway_loadtest", "matplotlib", "paho", "pandas", "polars", "pyarrow",
    "starlette", "sumolib", "uvicorn", "zstandard",
}  # fmt: skip
ELSEWHERE = (
    "headway.dashboard", "headway.detector", "headway.explain", "headway.gateways", "headway.result", "numba.cuda",
    "rich.progress", "scipy.linalg", "scipy.stats",
)  # fmt: skip
SERVE = """
import sys
import headway.cli.app
import headway.cli.run.serve
print(*sys.modules)
"""


def test_serving_imports_nothing_heavy_and_no_other_command() -> None:
    modules = subprocess.run([sys.executable, "-c", SERVE], capture_output=True, text=True, check=True).stdout.split()
    assert {"numba", "zenoh", "headway.core.engine"} <= set(modules)
    assert not HEAVY & {module.partition(".")[0] for module in modules}
    assert [module for module in modules if module.startswith(ELSEWHERE)] == []
