"""What pytest-benchmark wrote, as the tables of docs/PERFORMANCE.md: medians per reading, and ratios."""

import json
import sys
from pathlib import Path
from typing import Any

US = 1e6


def per_reading(results: list[dict[str, Any]]) -> dict[str, float]:
    """Return microseconds per reading by the name of the test."""
    return {
        result["name"]: US * result["stats"]["median"] / result["extra_info"]["readings"]
        for result in results
        if "readings" in result["extra_info"]
    }


def lines(results: list[dict[str, Any]]) -> list[str]:
    """Return the lines of both tables."""
    cost = per_reading(results)
    services = {r["name"]: r["extra_info"]["cpu_us"] for r in results if "cpu_us" in r["extra_info"]}
    ours = {model: cost.get(f"test_ours[{model}-1000]") for model in ("headway", "ekf", "ca")}
    told = ["| | us per reading | of `headway` | of `ekf` | of `ca` |", "| --- | ---: | ---: | ---: | ---: |"]
    for name, value in cost.items():
        ratios = " | ".join(f"{value / ours[model]:.1f}" if ours[model] else "-" for model in ours)
        told.append(f"| {name.removeprefix('test_').replace('_', ' ')} | {value:.3f} | {ratios} |")
    told += ["", "| service | CPU us per message |", "| --- | ---: |"]
    told += [f"| {name.removeprefix('test_a_service')} | {value:.1f} |" for name, value in services.items()]
    return told


if __name__ == "__main__":
    sys.stdout.write("\n".join(lines(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))["benchmarks"])) + "\n")
