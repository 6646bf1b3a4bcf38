"""The service's default model on the published experiment: same followers, same lies, same delay, and no oracle.

A rejected reading is never learnt from, here as in the service, and the model has no gate to turn: its statistic, the
log odds of a lie, is the same whatever is done with it. So its ROC needs one run, and its AUC is that of the statistic.
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
    """Return the AUC by severity for one follower's drive, its lies of each severity judged side by side."""
    model = build(DetectorConfig(model=NAME, delay_s=delay_s))
    told = np.stack([corrupted.readings for corrupted in by_severity.values()], axis=1)
    n, m = told.shape
    judged = verdicts(n * m).reshape(n, m)
    bank, rows = np.zeros(m, model.dtype), np.arange(m)
    for k in range(n):
        model.step_batch(bank, rows, told[k], model.params, judged[k])
    return {
        severity: auc(judged["statistic"][:, i], corrupted.anomalous)
        for i, (severity, corrupted) in enumerate(by_severity.items())
    }
