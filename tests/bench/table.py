"""What pytest-benchmark wrote, as the tables of docs/PERFORMANCE.md: medians per reading, ratios, and what is held."""

import json
import sys
from pathlib import Path
from typing import Any

US = 1e6
MODES = 10
LIKE_FOR_LIKE = (
    ("a single filter: `ekf` beside filterpy's", "ekf", 1, "FilterpyPair", 100),
    ("a single filter: `ekf` beside Stone Soup's", "ekf", 1, "StoneSoupPair", 300),
    ("ten filters: `headway` beside filterpy's ten interacting models", "headway", 1, "FilterpyTen", 100),
    ("one update of one filter: a tenth of `headway` beside filterpy's", "headway", MODES, "FilterpyPair", 100),
    ("one update of one filter: a tenth of `headway` beside Stone Soup's", "headway", MODES, "StoneSoupPair", 300),
)
"""What is compared, our model and how many updates its reading is, theirs, and the ratio aimed at."""
HELD_TARGET = 10


def per_reading(results: list[dict[str, Any]]) -> dict[str, float]:
    """Return microseconds per reading by the name of the test."""
    return {
        result["name"]: US * result["stats"]["median"] / result["extra_info"]["readings"]
        for result in results
        if "readings" in result["extra_info"]
    }


def ratio(value: float, target: float) -> str:
    """Return a ratio and whether it is what was aimed at."""
    return f"{value:.1f} | {target} | {'met' if value >= target else 'missed'}"


def lines(results: list[dict[str, Any]]) -> list[str]:
    """Return the lines of all tables."""
    cost = per_reading(results)
    services = {r["name"]: r["extra_info"]["cpu_us"] for r in results if "cpu_us" in r["extra_info"]}
    ours = {model: cost.get(f"test_ours[{model}-1000]") for model in ("headway", "ekf", "ca")}
    shown = ["| | us per reading | of `headway` | of `ekf` | of `ca` |", "| --- | ---: | ---: | ---: | ---: |"]
    for name, value in cost.items():
        ratios = " | ".join(f"{value / ours[model]:.1f}" if ours[model] else "-" for model in ours)
        shown.append(f"| {name.removeprefix('test_').replace('_', ' ')} | {value:.3f} | {ratios} |")
    shown += ["", "| like for like, 1,000 pairs | ours us | theirs us | ratio | target | |"]
    shown.append("| --- | ---: | ---: | ---: | ---: | --- |")
    for what, model, updates, kind, target in LIKE_FOR_LIKE:
        own, theirs = ours[model], cost.get(f"test_a_hundred_objects[{kind}]")
        if own and theirs:
            shown.append(f"| {what} | {own / updates:.3f} | {theirs:.1f} | {ratio(theirs * updates / own, target)} |")
    shown += ["", "| service | CPU us per message |", "| --- | ---: |"]
    shown += [f"| {name.removeprefix('test_a_service')} | {value:.1f} |" for name, value in services.items()]
    return shown + most_held(results)


def most_held(results: list[dict[str, Any]]) -> list[str]:
    """Return the lines of the table of what each service holds, and of ours beside each."""
    held = {
        (result["params"]["who"], result["extra_info"]["held"]["bundle"]): result["extra_info"]["held"]
        for result in results
        if "held" in result["extra_info"]
    }
    shown = ["", "| the most held | bundle | vehicles at 10 Hz | ours by it | target | | CPU us a message | of ours |"]
    shown.append("| --- | ---: | ---: | ---: | ---: | --- | ---: | ---: |")
    for (who, bundle), most in held.items():
        own, more, dearer = held.get(("ours", bundle)), " | | ", ""
        if own is not None and own is not most:
            more = ratio(own["vehicles"] / most["vehicles"], HELD_TARGET)
            dearer = f"{most['cpu_us'] / own['cpu_us']:.1f}"
        shown.append(f"| {who} | {bundle} | {most['vehicles']:,} | {more} | {most['cpu_us']:.1f} | {dearer} |")
    return shown


if __name__ == "__main__":
    sys.stdout.write("\n".join(lines(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))["benchmarks"])) + "\n")
