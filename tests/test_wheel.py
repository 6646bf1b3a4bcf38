"""The wheel that is built holds the code, what the code needs beside it, and the licence; `make wheel` runs it."""

import subprocess
import sys
import zipfile
from email.parser import Parser
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = {"headway": "service", "headway_schemas": "schemas", "headway_loadtest": "loadtest"}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    folder = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder), str(ROOT)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    [file] = folder.glob("*.whl")
    return zipfile.ZipFile(file)


def in_info(wheel: zipfile.ZipFile, name: str) -> str:
    [found] = [entry for entry in wheel.namelist() if entry.endswith(f".dist-info/{name}")]
    return wheel.read(found).decode()


def test_every_file_of_the_packages_is_in_it_and_nothing_else(wheel: zipfile.ZipFile) -> None:
    there = {
        file.relative_to(ROOT / folder).as_posix()
        for name, folder in PACKAGES.items()
        for file in (ROOT / folder / name).rglob("*")
        if file.is_file() and "__pycache__" not in file.parts
    }
    assert {name for name in wheel.namelist() if ".dist-info/" not in name} == there


def test_its_metadata_say_what_it_is(wheel: zipfile.ZipFile) -> None:
    metadata = Parser().parsestr(in_info(wheel, "METADATA"))
    assert (metadata["Name"], metadata["License-Expression"]) == ("headway", "Apache-2.0")
    assert metadata["Requires-Python"] == ">=3.11"
    assert "Typing :: Typed" in metadata.get_all("Classifier", [])
    assert {url.partition(",")[0] for url in metadata.get_all("Project-URL", [])} >= {"Homepage", "Source", "Changelog"}
    assert set(metadata.get_all("Provides-Extra", [])) >= {"recordings", "plots", "dashboard", "dev"}
    assert "headway = headway.__main__:main" in in_info(wheel, "entry_points.txt")
    assert in_info(wheel, "licenses/LICENSE") == (ROOT / "LICENSE").read_text()
