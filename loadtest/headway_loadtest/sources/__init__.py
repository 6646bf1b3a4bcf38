"""Sources of drives: SPMD folders, pair files, or a synthetic fleet, named on the command line.

Readers of recorded drives are imported when a word asks for them: they need polars, and a synthetic fleet does not.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

from headway_loadtest.sources.drive import Scene, SourceError
from headway_loadtest.sources.synthetic import SyntheticDrives

SYNTHETIC = "synthetic:"
HOST_TABLE, TARGETS_TABLE, MESSAGES_TABLE = "DataWsu", "DataFrontTargets", "BsmP1"

VEHICLES_MAX = 5_000
"""Of a synthetic fleet: more than two cores carry in single messages with this generator beside."""

__all__ = ["Source", "SourceError", "parse_sources", "synthetic_vehicles"]


@dataclass(frozen=True, slots=True)
class Source:
    """Scenes of several sources, one after the other; each iteration reads them again."""

    parts: Sequence[Iterable[Scene]]

    def __iter__(self) -> Iterator[Scene]:
        return chain.from_iterable(self.parts)


def parse_sources(words: Sequence[str], *, seconds: float, seed: int) -> Source:
    """Read the SOURCE words of the command line: an SPMD folder, pair files, or `synthetic:N`.

    Files are opened when their scenes are asked for. `seconds` and `seed` are the synthetic fleet's.

    Raises
    ------
    SourceError
        A word names no source.
    """
    if not words:
        raise SourceError("no source: name an SPMD folder, pair files, or synthetic:N")
    parts: list[Iterable[Scene]] = []
    pair_files: list[Path] = []
    for word in words:
        if word.startswith(SYNTHETIC):
            parts.append(SyntheticDrives(synthetic_vehicles(word), seconds, seed))
            continue
        path = Path(word)
        if path.is_dir():
            parts.extend(_folder(path))
        elif not path.is_file():
            raise SourceError(f"{word}: no such file or folder")
        elif HOST_TABLE in path.name or MESSAGES_TABLE in path.name:
            parts.append(_table(path))
        else:
            pair_files.append(path)
    if pair_files:
        from headway_loadtest.sources.pairs import Pairs

        parts.append(Pairs(pair_files))
    return Source(parts)


def _folder(folder: Path) -> list[Iterable[Scene]]:
    tables = sorted(path for path in folder.glob("*.csv") if HOST_TABLE in path.name or MESSAGES_TABLE in path.name)
    if not tables:
        raise SourceError(
            f"{folder}: no *{HOST_TABLE}*.csv or *{MESSAGES_TABLE}*.csv in it; give the pair files by name"
        )
    return [_table(path) for path in tables]


def _table(path: Path) -> Iterable[Scene]:
    if MESSAGES_TABLE in path.name:
        from headway_loadtest.sources.bsm_p1 import BsmP1

        return BsmP1(path)
    from headway_loadtest.sources.spmd import SpmdTrips

    targets = path.with_name(path.name.replace(HOST_TABLE, TARGETS_TABLE))
    return SpmdTrips(path, targets if targets.is_file() else None)


def synthetic_vehicles(word: str) -> int:
    """Return N of `synthetic:N`, and 0 of any other word.

    Raises
    ------
    SourceError
        N is no number of vehicles that can drive at once.
    """
    if not word.startswith(SYNTHETIC):
        return 0
    count = word.removeprefix(SYNTHETIC)
    if not (count.isdecimal() and int(count) > 0):
        raise SourceError(f"{word}: write {SYNTHETIC}N with N vehicles, for example {SYNTHETIC}100")
    if int(count) > VEHICLES_MAX:
        raise SourceError(f"{word}: at most {VEHICLES_MAX} vehicles; `headway loadtest --bundle K` offers more")
    return int(count)
