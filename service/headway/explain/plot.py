"""The picture of `headway explain`: innovations with their expected spread, the statistic and its gate."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from headway.errors import UserError
from headway.explain.compare import Explained


def draw(explained: Sequence[Explained], file: Path) -> None:
    """Draw the readings of all updates against the prediction, and the statistic against the gate.

    Raises
    ------
    UserError
        There are no readings, or the file cannot be written.
    """
    by_time = {
        float(z["t_s"]): (z, verdict)
        for one in explained
        if one.readings is not None and one.verdicts is not None
        for z, verdict in zip(one.readings, one.verdicts, strict=True)
    }
    if not by_time:
        raise UserError(f"{explained[0].event.event_id}: no readings to plot, {explained[0].problem}")
    times = sorted(by_time)
    readings, verdicts = (np.array([by_time[t][i] for t in times]) for i in (0, 1))
    t_s = np.array(times) - 1e-6 * explained[0].event.t_us
    figure = Figure(figsize=(9, 8), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(3, 1, sharex=True)
    for i, (axis, name, label) in enumerate(zip(axes, ("x_m", "v_mps"), ("location (m)", "speed (m/s)"), strict=False)):
        std = np.sqrt(verdicts["S"][:, i, i])
        axis.fill_between(t_s, -2 * std, 2 * std, alpha=0.2, label="expected, two standard deviations")
        axis.plot(t_s, verdicts["nu"][:, i], "o-", markersize=3, label="reading less prediction")
        axis.plot(t_s, verdicts[name] - readings[name] + verdicts["nu"][:, i], label="recovered less prediction")
        axis.set_ylabel(label)
    axes[0].legend(loc="best", fontsize="small")
    axes[2].plot(t_s, verdicts["statistic"], label="statistic")
    axes[2].plot(t_s, verdicts["gate"], "--", label="gate")
    axes[2].set_ylabel("statistic")
    axes[2].legend(loc="best", fontsize="small")
    axes[2].set_xlabel("time since the onset (s)")
    for axis in axes:
        for one in explained:
            axis.axvline(1e-6 * (one.event.t_us - explained[0].event.t_us), color="grey", linewidth=0.5)
    event = explained[0].event
    figure.suptitle(f"{event.event_id}: {event.kind} of {event.sensor}, suspect {event.suspect}")
    try:
        figure.savefig(file, dpi=120)
    except (OSError, ValueError) as error:
        raise UserError(f"{file}: {error}") from None
