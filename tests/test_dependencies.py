"""What `pip install headway` brings is enough for most commands; the others name the extra that is absent."""

import re
import subprocess
import sys
import tomllib
from contextlib import suppress
from importlib import metadata
from pathlib import Path

import pytest

from headway.cli.app import EXTRAS

ROOT = Path(__file__).parents[1]
NAME = re.compile(r"[A-Za-z0-9._-]+")
BASE = ["serve", "judge", "alerts", "alerts_export", "demo", "loadtest", "replay"]


def required(*extras: str) -> set[str]:
    """Distributions that the project needs, with all that they need in turn: without extras, or with some."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    waiting = [*project["dependencies"], *(one for extra in extras for one in project["optional-dependencies"][extra])]
    found: set[str] = set()
    while waiting:
        requirement, _, marker = waiting.pop().partition(";")
        name = NAME.match(requirement)
        assert name
        if "extra ==" in marker or (bare := name[0].lower().replace("_", "-")) in found:
            continue
        found.add(bare)
        with suppress(metadata.PackageNotFoundError):  # what another platform needs
            waiting += metadata.requires(bare) or []
    return found


BLOCKING = """
import sys
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition('.')[0] in {absent}:
            raise ModuleNotFoundError(name)
sys.meta_path.insert(0, Absent())
import {module}
"""


@pytest.mark.parametrize("command", BASE)
def test_a_command_needs_nothing_that_the_project_does_not_require(command: str) -> None:
    here = required()
    absent = {
        name
        for name, owners in metadata.packages_distributions().items()
        if not any(owner.lower().replace("_", "-") in here or owner == "headway" for owner in owners)
    }
    assert {"polars", "starlette", "matplotlib"} <= absent
    code = BLOCKING.format(absent=absent, module=f"headway.cli.run.{command}")
    subprocess.run([sys.executable, "-c", code], check=True)


def test_every_extra_is_declared_and_brings_the_package_it_is_named_for() -> None:
    brought = {package: required(extra) for package, extra in EXTRAS.items()}
    owners = metadata.packages_distributions()
    assert all(brought[package] & {owner.lower().replace("_", "-") for owner in owners[package]} for package in EXTRAS)
    assert not {"polars", "pyarrow", "matplotlib", "starlette", "uvicorn", "zstandard"} & required()


@pytest.mark.parametrize(
    ("absent", "arguments"),
    [
        ("polars", ["replay", "pair.csv"]),
        ("polars", ["alerts", "export", "--journal", "journal.sqlite", "alerts.parquet"]),
        ("uvicorn", ["dashboard"]),
        ("ray", ["fleet", "status"]),
    ],
)
def test_what_is_absent_is_named_with_the_extra_that_brings_it(absent: str, arguments: list[str], tmp_path) -> None:
    columns = "t_s,leader_x_m,follower_x_m,leader_v_mps,follower_v_mps,leader_length_m"
    (tmp_path / "pair.csv").write_text(f"{columns}\n0,30,0,10,10,4\n0.1,31,1,10,10,4\n", encoding="utf-8")
    code = (
        f"import sys; sys.modules['{absent}'] = None; sys.argv = ['headway', *{arguments}];"
        "from headway.cli.app import main; main()"
    )
    ended = subprocess.run(
        [sys.executable, "-c", code],
        check=False,
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert ended.returncode == 2
    assert ended.stderr == f"headway: this needs {absent}: pip install 'headway[{EXTRAS[absent]}]'\n"
