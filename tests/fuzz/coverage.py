"""`make fuzz-coverage`: atheris chooses the inputs of one target, by the lines of Python that they reach.

It sees into decoders, readers and the engine, not into compiled kernels: those have the mutations of `campaign.py`. The
corpus is kept in `out/fuzz/corpus`; an input that raises is written to `out/fuzz`, and the process ends with an error.
"""

import argparse
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FunctionType
from typing import Any

import atheris
from fuzz.targets import TARGETS

SEEN = ("headway.edge.codec", "headway.feeds", "headway.gateways.recordings", "headway.core", "headway_schemas")


def functions() -> Iterator[Callable[..., Any]]:
    """Yield functions and methods of the modules that atheris shall see; a compiled kernel is neither."""
    for name, module in list(sys.modules.items()):
        if name.startswith(SEEN):
            for value in list(vars(module).values()):
                members = vars(value).values() if isinstance(value, type) else [value]
                yield from (one for one in members if isinstance(one, FunctionType) and one.__module__ == name)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("target", choices=list(TARGETS))
    parser.add_argument("--seconds", type=float, default=3_600.0)
    options = parser.parse_args()
    target, out = TARGETS[options.target], Path("out/fuzz")
    corpus = out / "corpus" / options.target.replace(" ", "-")
    corpus.mkdir(parents=True, exist_ok=True)
    for place, seed in enumerate(target.seeds()):
        (corpus / f"seed-{place}").write_bytes(seed)
    for function in functions():
        atheris.instrument_func(function)
    limits = [f"-max_total_time={options.seconds:.0f}", f"-artifact_prefix={out}/", "-rss_limit_mb=0"]
    atheris.Setup([sys.argv[0], *limits, str(corpus)], lambda data: target.run([data]))
    atheris.Fuzz()


if __name__ == "__main__":
    main()
