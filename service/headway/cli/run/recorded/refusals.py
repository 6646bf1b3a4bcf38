"""What recordings are read, and the rows of them that are refused: one line for each kind of thing."""

from collections.abc import Sequence
from dataclasses import dataclass

import typer

from headway.gateways.recordings.formats import AUTO, Located
from headway.gateways.recordings.reader import Source


@dataclass(frozen=True, slots=True)
class Reading:
    """What is read, and how."""

    sources: Sequence[str]
    form: str = AUTO
    columns: str | None = None


class Refusals:
    """Counts refused rows by their file, outcome and problem."""

    def __init__(self) -> None:
        self._refused: dict[tuple[int, str, str], tuple[Source, int, int]] = {}

    def add(self, located: Located, outcome: str, problem: str) -> None:
        """Count a row."""
        key = (id(located.source), outcome, problem)
        source, number, times = self._refused.get(key, (located.source, located.number, 0))
        self._refused[key] = (source, number, times + 1)

    def show(self) -> None:
        """Print the lines on standard error."""
        for (_, outcome, problem), (source, number, times) in self._refused.items():
            rows = f"{times:,} rows refused, first in line {number}" if times > 1 else f"line {number} refused"
            typer.echo(f"headway: {source.name}: {rows}: {outcome}: {problem}", err=True)
