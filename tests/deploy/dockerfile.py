"""The Dockerfile taken apart: instructions of the stage that builds and of the stage that is left."""

import re
from pathlib import Path

_TEXT = (Path(__file__).resolve().parents[2] / "docker" / "Dockerfile").read_text().replace("\\\n", " ")
Instructions = list[tuple[str, str]]
INSTRUCTIONS: Instructions = [
    (word, rest)
    for word, _, rest in (line.partition(" ") for line in _TEXT.splitlines() if line and not line.startswith("#"))
]
_LAST = max(i for i, (word, _) in enumerate(INSTRUCTIONS) if word == "FROM")
BUILD, FINAL = INSTRUCTIONS[:_LAST], INSTRUCTIONS[_LAST:]


def said(word: str, instructions: Instructions = INSTRUCTIONS) -> list[str]:
    """Return what follows each instruction of this name."""
    return [rest for instruction, rest in instructions if instruction == word]


def environment(instructions: Instructions = FINAL) -> dict[str, str]:
    """Return the variables that a stage sets."""
    return dict(re.findall(r"(\w+)=(\S*)", " ".join(said("ENV", instructions))))
