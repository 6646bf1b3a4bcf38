"""Figures of the evaluation on real pairs: what is found, and one drive as the default model saw it."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from headway.core.estimation import registry
from headway.core.types.config import DetectorConfig
from headway_loadtest.evaluate.pairs.drive import ALL, Pair, injected_drives, run_model
from headway_loadtest.sources.drive import F64

SHOWN_S = 40.0
SHOWN_FROM = 0.25
"""The pictured part of a drive begins after this share of it."""


def bars(result: Mapping[str, Any], measure: str, label: str) -> Figure:
    """Draw one measure: sets across, models beside each other, the spread over delays and kinds as a line."""
    groups = list(dict.fromkeys(row["set"] for row in result["rows"]))
    names = list(dict.fromkeys(row["model"] for row in result["rows"]))
    severities = list(dict.fromkeys(row["severity"] for row in result["rows"]))
    figure = Figure(figsize=(9, 3.2), layout="constrained")
    grid = figure.subplots(1, len(severities), sharey=True, squeeze=False)[0]
    for axes, severity in zip(grid, severities, strict=True):
        for place, name in enumerate(names):
            heights = [_values(result, measure, group, name, severity) for group in groups]
            at = np.arange(len(groups)) + 0.8 * ((place + 0.5) / len(names) - 0.5)
            axes.bar(at, [np.mean(h) if h else 0.0 for h in heights], 0.8 / len(names), label=name)
            for x, h in zip(at, heights, strict=True):
                axes.plot([x] * len(h), h, color="black", linewidth=1)
        axes.set_xticks(range(len(groups)), groups, fontsize=8)
        axes.set_title(f"c = {severity:g}", fontsize=9)
        axes.grid(axis="y", linewidth=0.3)
    grid[0].set_ylabel(label)
    grid[-1].legend(fontsize=8, loc="lower right")
    return figure


def _values(result: Mapping[str, Any], measure: str, group: str, model: str, severity: float) -> list[float]:
    return [
        row[measure]
        for row in result["rows"]
        if (row["set"], row["model"], row["severity"]) == (group, model, severity) and row[measure] is not None
    ]


def drive(pair: Pair, seed: int, severity: float = 1.0) -> Figure:
    """Draw part of a drive with injected events, as `headway` saw it."""
    drives = injected_drives(pair, 0, (severity,), (ALL,), 1, seed)
    results = run_model(registry.build(DetectorConfig()), pair, drives, seed)[:, -1]
    corrupted = drives[-1].corrupted
    first = int(SHOWN_FROM * len(pair.t_s))
    shown = slice(first, first + int(np.searchsorted(pair.t_s[first:], pair.t_s[first] + SHOWN_S)))
    t_s = pair.t_s[shown]
    figure = Figure(figsize=(9, 6), layout="constrained")
    location, speed, odds = figure.subplots(3, 1, sharex=True)
    for axes, reading, estimate, truth, label in (
        (location, corrupted.x_m, results["x_m"], pair.x_m, "location [m]"),
        (speed, corrupted.v_mps, results["v_mps"], pair.v_mps, "speed [m/s]"),
    ):
        axes.plot(t_s, (reading - truth)[shown], ".", color="tab:red", markersize=3, label="reading")
        axes.plot(t_s, (estimate - truth)[shown], color="tab:blue", linewidth=1, label="recovered")
        axes.set_ylabel(f"{label}\nless the truth")
    _shade(location, t_s, corrupted.x_kind[shown])
    _shade(speed, t_s, corrupted.v_kind[shown])
    odds.plot(t_s, results["statistic"][shown], color="tab:blue", linewidth=1, label="log odds")
    odds.plot(t_s, results["gate"][shown], color="black", linewidth=1, linestyle="--", label="gate")
    _shade(odds, t_s, corrupted.anomalous[shown])
    odds.set_xlabel("t [s]")
    for axes in (location, speed, odds):
        axes.legend(fontsize=8, loc="upper right")
    return figure


def _shade(axes: Axes, t_s: F64, faulty: Any) -> None:
    where = (np.asarray(faulty) > 0).tolist()
    axes.fill_between(t_s, 0, 1, where=where, step="mid", transform=axes.get_xaxis_transform(), color="red", alpha=0.12)
