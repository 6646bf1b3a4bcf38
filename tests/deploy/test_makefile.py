"""The Makefile says what it does: while it installs, and for each target."""

import re
import subprocess

from deploy.manifest import ROOT


def planned(target: str) -> list[str]:
    ended = subprocess.run(
        ["make", "--no-print-directory", "--dry-run", "--always-make", target],
        check=True,
        cwd=ROOT,
        stdout=subprocess.PIPE,
        text=True,
    )
    return ended.stdout.splitlines()


def test_an_installation_is_announced_and_shows_each_package() -> None:
    lines = planned("demo")
    [install] = [i for i, line in enumerate(lines) if "pip install" in line]
    assert "--quiet" not in lines[install]
    assert any(line.startswith("echo") and "minutes" in line for line in lines[:install])
    assert lines[-1].endswith("headway demo")


def test_every_target_is_in_the_help_and_made_whether_or_not_a_file_has_its_name() -> None:
    text = (ROOT / "Makefile").read_text()
    targets = set(re.findall(r"^([a-z-]+):", text, re.MULTILINE))
    helped = set(re.findall(r"^([a-z-]+):.*## ", text, re.MULTILINE))
    phony = set(re.search(r"^\.PHONY: (.+)$", text, re.MULTILINE)[1].split())  # type: ignore[index]
    assert targets == helped == phony
