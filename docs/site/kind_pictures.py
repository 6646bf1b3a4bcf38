"""Make the pictures of `docs/explain/reading_an_alert.md`: one fault of each kind, found by the detector.

Run `python docs/site/kind_pictures.py docs/images/kinds`. The same pictures come out each time.
"""

import sys
from collections.abc import Callable
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from headway import Detector

START_US = 1_700_000_000_000_000
METRES_PER_DEGREE = 111_132.0
SECONDS, FAULT_S, SHOWN_S = 70.0, 50.0, (46.0, 60.0)

F64 = NDArray[np.float64]


def short(t_s: F64, north_m: F64, _v_mps: F64, _rng: np.random.Generator) -> None:
    """Move one position in thirty by 4 m."""
    north_m[(t_s >= FAULT_S) & (np.arange(t_s.size) % 30 == 0)] += 4.0


def noise(t_s: F64, _north_m: F64, v_mps: F64, rng: np.random.Generator) -> None:
    """Let the speed scatter by 1 m/s."""
    faulty = (t_s >= FAULT_S) & (t_s < FAULT_S + 6.0)
    v_mps[faulty] += rng.normal(0.0, 1.0, int(faulty.sum()))


def bias(t_s: F64, north_m: F64, _v_mps: F64, _rng: np.random.Generator) -> None:
    """Put the position 3 m back."""
    north_m[(t_s >= FAULT_S) & (t_s < FAULT_S + 6.0)] -= 3.0


def drift(t_s: F64, north_m: F64, _v_mps: F64, _rng: np.random.Generator) -> None:
    """Let the position move away by half a metre each second."""
    faulty = (t_s >= FAULT_S) & (t_s < FAULT_S + 6.0)
    north_m[faulty] += 0.5 * (t_s[faulty] - FAULT_S)


KINDS: dict[str, Callable[[F64, F64, F64, np.random.Generator], None]] = {
    "short": short,
    "noise": noise,
    "bias": bias,
    "drift": drift,
}


def main(folder: str) -> None:
    """Write a picture for each kind."""
    mpl.use("Agg")
    Path(folder).mkdir(parents=True, exist_ok=True)
    for name, inject in KINDS.items():
        result = Detector().process(_records(inject))
        kinds = {str(event.kind) for event in result.events}
        if name not in kinds:
            raise SystemExit(f"{name}: the detector found {kinds or 'nothing'}")
        figure = result.plot("car-2")
        for axes in figure.axes:
            axes.set_xlim(*SHOWN_S)
            if axes is not figure.axes[-1]:
                _fit(axes)
        figure.savefig(Path(folder) / f"{name}.png", dpi=80, metadata={"Software": None})


def _records(inject: Callable[[F64, F64, F64, np.random.Generator], None]) -> list[dict[str, object]]:
    """Return two cars, the second one with a fault."""
    rng, records = np.random.default_rng(3), list[dict[str, object]]()
    t_s = np.arange(0.0, SECONDS, 0.1)
    for car, delay_s, behind_m in (("car-1", 0.0, 0.0), ("car-2", 1.2, 12.0)):
        at_s = t_s - delay_s
        v_mps = 14.0 + 2.0 * np.sin(at_s / 7.0) + rng.normal(0.0, 0.03, t_s.size)
        north_m = 14.0 * at_s - 14.0 * np.cos(at_s / 7.0) - behind_m + rng.normal(0.0, 0.05, t_s.size)
        if car == "car-2":
            inject(t_s, north_m, v_mps, rng)
        for k, t in enumerate(t_s):
            t_us = START_US + round(t * 1e6)
            lat = 42.28 + float(north_m[k]) / METRES_PER_DEGREE
            records.append(
                {
                    "v": 1, "id": car, "msg_cnt": k % 128, "t_us": t_us, "received_us": t_us + 20_000, "lat": lat,
                    "lon": -83.7432, "speed_mps": max(float(v_mps[k]), 0.0), "heading_deg": 0.0,
                }
            )  # fmt: skip
    return sorted(records, key=lambda record: (record["t_us"], record["id"]))


def _fit(axes: Axes) -> None:
    """Scale the y axis to what is shown."""
    low, high = SHOWN_S
    shown = []
    for line in axes.get_lines():
        x, y = np.asarray(line.get_xdata(), float), np.asarray(line.get_ydata(), float)
        if x.size == y.size:
            shown.append(y[(x >= low) & (x <= high) & np.isfinite(y)])
    values = np.concatenate([part for part in shown if part.size] or [np.zeros(1)])
    margin = 0.05 * max(float(np.ptp(values)), 1e-3)
    axes.set_ylim(values.min() - margin, values.max() + margin)


if __name__ == "__main__":
    main(sys.argv[1])
