"""The picture of `Result.plot`; needs matplotlib."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

if TYPE_CHECKING:
    from headway.result import Result


def draw(result: "Result", vehicle: str) -> Figure:
    """Draw speed, location less its estimate, and statistic over gate of one vehicle."""
    at = np.flatnonzero(result.readings.ids == vehicle.encode())
    if not at.size:
        raise ValueError(f"no record of {vehicle} was judged in this chunk")
    verdicts, x_m, v_mps = result.verdicts[at], result.readings.x_m[at], result.readings.v_mps[at]
    t_s = (result.readings.t_us[at] - result.readings.t_us[at[0]]) / 1e6
    figure = Figure(figsize=(9, 7), layout="constrained")
    speed, location, statistic = figure.subplots(3, sharex=True)
    speed.plot(t_s, v_mps, ".", label="reported")
    speed.plot(t_s, verdicts["v_mps"], label="estimate")
    speed.set(ylabel="speed, m/s", title=vehicle)
    location.plot(t_s, x_m - verdicts["x_m"], ".", label="reported less estimate")
    location.set(ylabel="location, m")
    statistic.plot(t_s, verdicts["statistic"] / verdicts["gate"], ".", label="statistic / gate")
    statistic.axhline(1.0, color="tab:red", linewidth=0.8)
    statistic.set(ylabel="statistic / gate", xlabel=f"s after {vehicle}'s first record")
    statistic.set_yscale("symlog", linthresh=1.0)
    statistic.yaxis.set_major_formatter("{x:g}")
    for axes in (speed, location, statistic):
        axes.fill_between(
            t_s,
            *axes.get_ylim(),
            where=verdicts["anomalous"],
            color="tab:red",
            alpha=0.15,
            step="mid",
            label="anomalous",
        )
        axes.margins(x=0)
        axes.legend(loc="upper left")
    return figure
