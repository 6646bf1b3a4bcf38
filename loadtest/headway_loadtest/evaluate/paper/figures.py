"""The figures of the published experiment: ROC curves, normalised innovations (Figure 2), and one run."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from headway.core.types.records import Records
from headway_loadtest.evaluate.paper.experiment import CURVE_FPR, DELAYS_S, MODELS, SEVERITIES, PaperResult, Protocol
from headway_loadtest.evaluate.paper.follower import CorruptedReadings, Follower, corrupt, drive
from headway_loadtest.evaluate.paper.leader import Leader
from headway_loadtest.evaluate.paper.loop import params, run
from headway_loadtest.evaluate.paper.roc import Bools
from headway_loadtest.sources.drive import F64

GATE = 0.8
"""Threshold on nis in Figure 2; its circle has the radius of its root."""
DELAY_S = 1.5
SEVERITY = 1.0
WINDOW = slice(800, 1100)
"""Samples of the pictured run: half a minute, away from the start."""
COLOURS = {"ekf": "tab:blue", "aekf": "tab:orange"}
NAMES = {"ekf": "Model 1 (ekf)", "aekf": "Model 2 (aekf)"}


def roc_figure(result: PaperResult) -> Figure:
    """Draw the nine cells: severity down, delay across, both models in each."""
    figure = Figure(figsize=(8, 7), layout="constrained")
    grid = figure.subplots(len(SEVERITIES), len(DELAYS_S), sharex=True, sharey=True)
    auc = {(row.model, row.delay_s, row.severity): row.auc for row in result.table1}
    for axes_row, severity in zip(grid, SEVERITIES, strict=True):
        for axes, delay_s in zip(axes_row, DELAYS_S, strict=True):
            for model in MODELS:
                cell = (model, delay_s, severity)
                axes.plot(CURVE_FPR, result.curves[cell], color=COLOURS[model], label=f"{model} {auc[cell]:.3f}")
            axes.plot((0, 1), (0, 1), color="grey", linewidth=0.5)
            axes.set_title(f"c = {severity:g}, tau = {delay_s:g} s", fontsize=9)
            axes.legend(loc="lower right", fontsize=8)
    figure.supxlabel("false-positive rate")
    figure.supylabel("true-positive rate")
    return figure


def innovation_figure(leader: Leader, protocol: Protocol) -> Figure:
    """Draw L^-1 nu with S = L L' (its squared length is nis) of both models over one drive, and the gate's circle."""
    figure = Figure(figsize=(8, 4.4), layout="constrained")
    follower = drive(leader, DELAY_S, protocol.delay_jitter_s, protocol.seed)
    corrupted = corrupt(follower, SEVERITY, protocol.seed)
    for axes, model in zip(figure.subplots(1, 2, sharex=True, sharey=True), MODELS, strict=True):
        results = _results(model, protocol, follower, corrupted)
        nu: F64 = np.linalg.solve(np.linalg.cholesky(results["S"]), results["nu"][:, :, None])[:, :, 0]
        for label, colour, rows in (
            ("normal", "tab:green", ~corrupted.anomalous),
            ("anomalous", "tab:red", corrupted.anomalous),
        ):
            axes.scatter(*nu[rows].T, s=3, color=colour, label=label, alpha=0.5)
        axes.add_patch(Circle((0.0, 0.0), GATE**0.5, fill=False, linewidth=1.5))
        axes.set(title=NAMES[model], xlim=(-4, 4), ylim=(-4, 4), aspect="equal")
        axes.legend(loc="upper right", fontsize=8)
    figure.supxlabel("normalised innovation of location")
    figure.supylabel("normalised innovation of speed")
    return figure


def run_figure(leader: Leader, protocol: Protocol, model: str = "aekf") -> Figure:
    """Draw one minute of a run: speeds, location error, statistic and gate, with the labelled rows shaded."""
    follower = drive(leader, DELAY_S, protocol.delay_jitter_s, protocol.seed)
    corrupted = corrupt(follower, SEVERITY, protocol.seed)
    results = _results(model, protocol, follower, corrupted)[WINDOW]
    read = corrupted.readings[WINDOW]
    t_s = read["t_s"]
    figure = Figure(figsize=(8, 7), layout="constrained")
    speed, location, statistic = figure.subplots(3, 1, sharex=True)
    speed.plot(t_s, leader.v_mps[WINDOW], color="grey", label="leader")
    speed.plot(t_s, follower.v_mps[WINDOW], color="black", label="follower")
    speed.plot(t_s, read["v_mps"], ".", markersize=2, color="tab:red", label="reading")
    speed.plot(t_s, results["v_mps"], color="tab:orange", linewidth=1, label="estimate")
    speed.set_ylabel("speed [m/s]")
    location.plot(t_s, read["x_m"] - follower.x_m[WINDOW], ".", markersize=2, color="tab:red", label="reading")
    location.plot(t_s, results["x_m"] - follower.x_m[WINDOW], color="tab:orange", linewidth=1, label="estimate")
    location.set_ylabel("location less the truth [m]")
    statistic.semilogy(t_s, results["nis"], color="tab:blue", linewidth=1, label="nis")
    statistic.axhline(GATE, color="black", linestyle="--", linewidth=1, label="gate")
    statistic.set(ylabel="nis", xlabel="t [s]", ylim=(1e-4, None))
    for axes in (speed, location, statistic):
        _shade(axes, t_s, corrupted.anomalous[WINDOW])
        axes.legend(loc="upper right", fontsize=8)
    figure.suptitle(
        f"{NAMES[model]}, tau = {DELAY_S:g} s, c = {SEVERITY:g}, recovery {protocol.recovery}, "
        f"seed {protocol.seed}; shaded: labelled anomalous",
        fontsize=10,
    )
    return figure


def _results(model: str, protocol: Protocol, follower: Follower, corrupted: CorruptedReadings) -> Records:
    p = params(model, DELAY_S, protocol.delay_jitter_s)._replace(gate=GATE)
    return run(model, p, follower, corrupted.readings, protocol.recovery, protocol.history)


def _shade(axes: Axes, t_s: F64, anomalous: Bools) -> None:
    axes.fill_between(
        t_s, 0, 1, where=anomalous.tolist(), step="mid", transform=axes.get_xaxis_transform(), color="red", alpha=0.15
    )


def save(figure: Figure, path: Path) -> None:
    """Write a PNG, small enough to be read beside the text."""
    figure.savefig(path, dpi=70, bbox_inches="tight")
