"""`make fuzz`: mutates the seeds of each target in turn, for a time or a number of records, and reports the outcomes.

An input that raises is written to `out/fuzz`. Memory is read every minute, from the fifth on: it must be flat.
"""

import argparse
import sys
import time
import traceback
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from fuzz.mutate import Mutator
from fuzz.targets import TARGETS, Target

from headway.core.types.outcome import Outcome

FLAT_SHARE = 1.05
INFINITE = float("inf")
_WARM_S, _EVERY_S = 300.0, 60.0
_WARM_SHARE = 0.2
"""A shorter campaign is warm after this share of it: caches are full by then."""


@dataclass
class Campaign:
    """What came of it, by target."""

    seed: int
    out: Path | None = None
    outcomes: dict[str, Counter[Outcome]] = field(default_factory=dict)
    inputs: Counter[str] = field(default_factory=Counter)
    failures: list[str] = field(default_factory=list)

    def run(
        self, names: Iterable[str], *, seconds: float = INFINITE, records: float = INFINITE, inputs: float = INFINITE
    ) -> None:
        """Fuzz targets in turn until so many seconds or records are over, or each target had so many inputs."""
        rng, began_s, done = np.random.default_rng(self.seed), time.monotonic(), 0
        mutators = {name: Mutator(TARGETS[name].seeds(), rng) for name in names}
        while left := [name for name in mutators if self.inputs[name] < inputs]:
            for name in left:
                if time.monotonic() - began_s >= seconds or done >= records:
                    return
                done += self._turn(name, TARGETS[name], mutators[name])

    def had(self, names: Iterable[str], inputs: float) -> bool:
        """Whether each of these targets had so many inputs."""
        return all(self.inputs[name] >= inputs for name in names)

    @property
    def records(self) -> int:
        """Records that had an outcome."""
        return sum(counts.total() for counts in self.outcomes.values())

    def _turn(self, name: str, target: Target, mutator: Mutator) -> int:
        """Run some inputs of a target; return how many records they held."""
        inputs = [mutator.next() for _ in range(target.at_once)]
        self.inputs[name] += len(inputs)
        try:
            counts = target.run(inputs)
        except Exception as error:  # noqa: BLE001 - whatever it is, it must not be
            self.failures.append(f"{name}: {type(error).__name__}: {error}")
            self._keep(name, inputs)
            return 0
        self.outcomes.setdefault(name, Counter()).update(counts)
        return counts.total()

    def _keep(self, name: str, inputs: list[bytes]) -> None:
        if self.out is None:
            return
        self.out.mkdir(parents=True, exist_ok=True)
        for place, content in enumerate(inputs):
            (self.out / f"{name.replace(' ', '-')}-{len(self.failures)}-{place}").write_bytes(content)
        (self.out / f"{name.replace(' ', '-')}-{len(self.failures)}.txt").write_text(traceback.format_exc())


def rss_mb() -> float:
    """Return the resident memory of this process."""
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * 4_096 / 1e6


def report(campaign: Campaign) -> None:
    """Print the counts by target and outcome."""
    for name, counts in campaign.outcomes.items():
        shown = ", ".join(f"{outcome.label} {n:,}" for outcome, n in counts.most_common())
        sys.stdout.write(f"{name}: {campaign.inputs[name]:,} inputs, {counts.total():,} records: {shown}\n")
    sys.stdout.write(f"{campaign.records:,} records, {len(campaign.failures)} failures\n")
    for failure in campaign.failures[:20]:
        sys.stdout.write(f"  {failure[:300]}\n")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=3_600.0)
    parser.add_argument("--records", type=float, default=INFINITE)
    parser.add_argument("--inputs", type=float, default=INFINITE, help="of each target")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--target", action="append", choices=list(TARGETS), help="all by default")
    options = parser.parse_args()
    names, warm_s = options.target or list(TARGETS), min(_WARM_S, _WARM_SHARE * options.seconds)
    campaign, memory_mb, began_s = Campaign(options.seed, Path("out/fuzz")), [], time.monotonic()
    left_s = options.seconds
    while left_s > 0.0 and campaign.records < options.records and not campaign.had(names, options.inputs):
        is_warm = options.seconds - left_s >= warm_s
        campaign.run(
            names,
            seconds=min(left_s, _EVERY_S if is_warm else warm_s),
            records=options.records - campaign.records,
            inputs=options.inputs,
        )
        campaign.seed += 1
        memory_mb.append(rss_mb())
        left_s = options.seconds - (time.monotonic() - began_s)
    report(campaign)
    growth = max(memory_mb) / memory_mb[0]
    sys.stdout.write(
        f"resident memory {memory_mb[0]:.0f} MB after {warm_s:.0f} s, then at most {growth:.3f} times it\n"
    )
    sys.exit(bool(campaign.failures) or growth > FLAT_SHARE)


if __name__ == "__main__":
    main()
