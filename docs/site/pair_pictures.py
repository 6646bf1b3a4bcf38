"""Make the pictures of `docs/explain/reading_an_alert.md` that show more than one vehicle.

Run `python docs/site/pair_pictures.py docs/images/kinds`. The same pictures come out each time.
"""

import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from headway import Detector
from headway_loadtest.evaluate.misbehaviour.platoons import LENGTH_M, synthetic
from headway_schemas import Phase

START_US = 1_700_000_000_000_000
METRES_PER_DEGREE = 111_132.0
SECONDS, FAULT_S, SHOWN_S = 150.0, 120.0, (116.0, 132.0)
CARS = 4
SUSPECT = 2
"""The third car."""

F64 = NDArray[np.float64]


class Drive(NamedTuple):
    """What four cars in a row declare: t_s (n,), x_m, v_mps and is_sent (n, 4); the third car's forward sensor (n,)."""

    t_s: F64
    x_m: F64
    v_mps: F64
    is_sent: NDArray[np.bool_]
    range_m: F64


class Picture(NamedTuple):
    """A quantity over time: its name, and each line by its label."""

    quantity: str
    lines: dict[str, F64]


def response(drive: Drive) -> Picture:
    """Let the third car report a brake of 3 m/s that did not happen, in position and speed."""
    part = np.clip((drive.t_s - FAULT_S) / 4.0, 0.0, 1.0)
    off_mps = -1.5 * (1.0 - np.cos(2.0 * np.pi * part))
    drive.v_mps[:, SUSPECT] += off_mps
    drive.x_m[:, SUSPECT] += np.cumsum(off_mps) * 0.1
    named = ("the car ahead", "the car that reports a brake", "the car behind")
    return Picture("speed, m/s", {name: drive.v_mps[:, SUSPECT - 1 + i] for i, name in enumerate(named)})


def range_(drive: Drive) -> Picture:
    """Let the position of the car ahead move away by 6 m in 10 s, with its speed."""
    part = np.clip((drive.t_s - FAULT_S) / 10.0, 0.0, 1.0)
    off_m = 6.0 * (3.0 * part**2 - 2.0 * part**3)
    drive.x_m[:, SUSPECT - 1] += off_m
    drive.v_mps[:, SUSPECT - 1] += np.gradient(off_m, 0.1)
    declared_m = drive.x_m[:, SUSPECT - 1] - drive.x_m[:, SUSPECT] - LENGTH_M
    return Picture("gap, m", {"by the declared positions": declared_m, "by the forward sensor": drive.range_m})


def miss(drive: Drive) -> Picture:
    """Let the third car send nothing for 4 s."""
    drive.is_sent[(drive.t_s >= FAULT_S) & (drive.t_s < FAULT_S + 4.0), SUSPECT] = False

    def silence(car: int) -> F64:
        sent_s = np.where(drive.is_sent[:, car], drive.t_s, -np.inf)
        return drive.t_s - np.maximum.accumulate(sent_s)

    return Picture(
        "time since the last message, s", {"the car behind": silence(SUSPECT + 1), "the car": silence(SUSPECT)}
    )


KINDS: dict[str, Callable[[Drive], Picture]] = {"response": response, "range": range_, "miss": miss}


def main(folder: str) -> None:
    """Write a picture for each kind."""
    mpl.use("Agg")
    Path(folder).mkdir(parents=True, exist_ok=True)
    for name, falsify in KINDS.items():
        drive = _drive()
        picture = falsify(drive)
        spans = list(_spans(name, drive))
        if not spans:
            raise SystemExit(f"{name}: the detector found nothing")
        figure = Figure(figsize=(9, 3.2), layout="constrained")
        axes = figure.subplots()
        shown = (drive.t_s >= SHOWN_S[0]) & (drive.t_s <= SHOWN_S[1])
        for label, values in picture.lines.items():
            axes.plot(drive.t_s[shown], values[shown], ".-", markersize=3, linewidth=0.8, label=label)
        axes.axvspan(
            min(begin for begin, _ in spans), max(end for _, end in spans), color="tab:red", alpha=0.15, label="event"
        )
        axes.set(xlim=SHOWN_S, xlabel="s", ylabel=picture.quantity)
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, frameon=False)
        figure.savefig(Path(folder) / f"{name}.png", dpi=80, metadata={"Software": None})


def _drive() -> Drive:
    """Return cars whose drivers follow each other, with the noise of their sensors."""
    rng = np.random.default_rng(1)
    driven = synthetic(rng, SECONDS, CARS)
    range_m = driven.x_m[:, SUSPECT - 1] - driven.x_m[:, SUSPECT] - LENGTH_M + rng.normal(0.0, 0.1, driven.t_s.size)
    x_m = driven.x_m + rng.normal(0.0, 0.05, driven.x_m.shape)
    v_mps = driven.v_mps + rng.normal(0.0, 0.03, driven.x_m.shape)
    return Drive(driven.t_s, x_m, v_mps, np.ones(x_m.shape, np.bool_), range_m)


def _records(drive: Drive, *, with_range: bool) -> Iterator[dict[str, object]]:
    """Yield what the cars send, in the order of time."""
    for k, t_s in enumerate(drive.t_s):
        t_us = START_US + round(t_s * 1e6)
        for car in np.flatnonzero(drive.is_sent[k]):
            record = {
                "v": 1, "id": f"car-{car + 1}", "msg_cnt": k % 128, "t_us": t_us, "received_us": t_us + 20_000,
                "lat": 42.28 + float(drive.x_m[k, car]) / METRES_PER_DEGREE, "lon": -83.7432,
                "speed_mps": max(float(drive.v_mps[k, car]), 0.0), "heading_deg": 0.0, "length_m": LENGTH_M,
            }  # fmt: skip
            if with_range and car == SUSPECT:
                record["leader"] = {"id": f"car-{SUSPECT}", "range_m": float(drive.range_m[k]), "range_rate_mps": None}
            yield record


def _spans(kind: str, drive: Drive) -> Iterator[tuple[float, float]]:
    """Yield begin and end of each event of a kind, s."""
    detector = Detector()
    result = detector.process(list(_records(drive, with_range=kind == "range")))
    for event in (*result.events, *detector.finish().events):
        if event.kind == kind and event.phase is Phase.CLEARED:
            yield ((event.onset_us or event.t_us) - START_US) / 1e6, (event.t_us - START_US) / 1e6


if __name__ == "__main__":
    main(sys.argv[1])
