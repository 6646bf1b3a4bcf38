"""Result of one test between two vehicles at one reading, and the budget of its gate."""

import numpy as np

from headway.core.statistics.alarm_gate import Budget

CHECK = np.dtype(
    [
        ("statistic", "f8"),  # in standard deviations
        ("gate", "f8"),
        ("p_value", "f8"),  # probability of such a statistic on clean readings, per test
        ("anomalous", "?"),
        ("warming", "?"),
    ],
    align=True,
)


def check_budget(alarms_per_hour: float) -> Budget:
    """Return the budget of a test whose statistic is in standard deviations.

    The prior is that of unexplained speed changes (ADR 0007, "Options for the gate"). Cruise control shows 30 to 60
    excursions an hour and humans 220 to 400, with a mean of 0.5 to 0.8. A Gaussian has a mean of 0.37.
    """
    return Budget(
        alarms_per_hour=alarms_per_hour,
        threshold=2.0,
        truncation=2.5,
        prior_mean=0.5,
        prior_rate_per_hour=200.0,
        prior_exceedances=30.0,
        holdoff_s=10.0,
        memory_s=3600.0,
    )
