"""The service's default model on the published experiment: same followers, faults and delay, and no oracle.

Its statistic, the log odds of a fault, does not depend on a gate, because no rejected reading is replaced. So its ROC
needs one run, and its AUC is that of the statistic.
"""

from collections.abc import Mapping

import numpy as np

from headway.core.estimation.registry import build
from headway.core.runtime.rows import verdicts
from headway.core.types.config import DetectorConfig
from headway_loadtest.evaluate.pairs.score import auc
from headway_loadtest.evaluate.paper.follower import CorruptedReadings

NAME = "headway"


def default_aucs(by_severity: Mapping[float, CorruptedReadings], delay_s: float) -> dict[float, float]:
    """Return the AUC by severity for one follower's drive, with a row of the bank for each severity."""
    model = build(DetectorConfig(model=NAME, delay_s=delay_s))
    columns = np.stack([corrupted.readings for corrupted in by_severity.values()], axis=1)
    n, m = columns.shape
    results = verdicts(n * m).reshape(n, m)
    bank, rows = np.zeros(m, model.dtype), np.arange(m)
    for k in range(n):
        model.step_batch(bank, rows, columns[k], model.params, results[k])
    return {
        severity: auc(results["statistic"][:, i], corrupted.anomalous)
        for i, (severity, corrupted) in enumerate(by_severity.items())
    }
