"""Load tests from few to many vehicles, and their picture: latency and cost against the number of vehicles.

Arguments: the folder for the results, one file for each load. A load whose file is there is not run again.
"""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

SECONDS = 15
LOADS = {1: (250, 500, 1_000, 2_000, 4_000, 6_000, 8_000), 25: (1_000, 2_500, 5_000, 10_000, 15_000, 20_000)}
"""Vehicles at 10 Hz, by records to a payload."""
NAMES = {1: "single messages", 25: "bundles of 25"}
COLOURS = {1: "#2a6f97", 25: "#c1666b"}


def measured(folder: Path, vehicles: int, bundle: int) -> dict[str, Any]:
    file = folder / f"loadtest-{bundle}-{vehicles}.json"
    if not file.exists():
        options = ["--vehicles", str(vehicles), "--bundle", str(bundle), "--seconds", str(SECONDS)]
        command = [sys.executable, "-m", "headway", "loadtest", *options, "--json"]
        shown = subprocess.run(command, check=False, stdout=subprocess.PIPE).stdout
        file.write_bytes(shown)
    return json.loads(file.read_text(encoding="utf-8"))


def draw(results: dict[int, list[dict[str, Any]]]) -> Figure:
    figure = Figure(figsize=(9.0, 3.8), layout="constrained")
    latency, cost = figure.subplots(1, 2)
    for bundle, runs in results.items():
        vehicles = [run["vehicles"] for run in runs]
        for name, style in (("p50", "-"), ("p99", "--")):
            values = [run["latency_ms"][name] for run in runs]
            latency.plot(vehicles, values, style, color=COLOURS[bundle], marker="o", label=f"{name}, {NAMES[bundle]}")
        values = [run["cpu_us_per_msg"]["service"] for run in runs]
        cost.plot(vehicles, values, color=COLOURS[bundle], marker="o", label=NAMES[bundle])
    _label(latency, "latency from the intended send time, ms")
    _label(cost, "processor time of the service, us per message")
    return figure


def _label(axes: Axes, what: str) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("vehicles at 10 Hz")
    axes.set_ylabel(what)
    axes.grid(visible=True, which="both", alpha=0.25)
    axes.legend(frameon=False, fontsize=8)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(mpl.ticker.FuncFormatter(lambda value, _: f"{value:g}"))


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    results = {bundle: [measured(folder, n, bundle) for n in vehicles] for bundle, vehicles in LOADS.items()}
    draw(results).savefig(folder / "performance.png", dpi=110)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
