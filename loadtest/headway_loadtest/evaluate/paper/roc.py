"""Receiver operating characteristic of a closed loop: one run of the detector per threshold.

A detection changes the later estimates of the filter. So the flags at one threshold do not follow from the statistic of
a run at another. The points need not be monotone either: they are ordered by false-positive rate. A threshold above and
one below every statistic give (0, 0) and (1, 1), which close the curve.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from headway_loadtest.sources.drive import F64

Bools = NDArray[np.bool_]
THRESHOLDS = 100


@dataclass(frozen=True, slots=True)
class Roc:
    """Rates of false and true positives, (m,) each, from (0, 0) to (1, 1), in order of the false ones."""

    fpr: F64
    tpr: F64

    @property
    def auc(self) -> float:
        """Area under the curve by the trapezoidal rule: 1 is perfect, 1/2 chance."""
        return float(np.trapezoid(self.tpr, self.fpr))


def thresholds(statistic: F64, count: int = THRESHOLDS) -> F64:
    """Return `count` quantiles, evenly spread from the smallest to the greatest value of a statistic (n,)."""
    made: F64 = np.quantile(statistic, np.linspace(0.0, 1.0, count))
    return made


def closed_loop(flags_at: Callable[[float], Bools], anomalous: Bools, gates: F64) -> Roc:
    """Run the detector once per gate; `flags_at(gate)` and `anomalous` are (n,).

    Raises
    ------
    ValueError
        When every sample is anomalous, or none: there is nothing to separate.
    """
    if anomalous.all() or not anomalous.any():
        raise ValueError("an ROC needs anomalous and normal samples")
    points = np.array([(f[~anomalous].mean(), f[anomalous].mean()) for f in map(flags_at, gates)])
    fpr, tpr = points[np.lexsort((points[:, 1], points[:, 0]))].T
    return Roc(np.r_[0.0, fpr, 1.0], np.r_[0.0, tpr, 1.0])
