"""What one test between two cars says of one reading; the same record for every such test."""

import numpy as np

CHECK = np.dtype(
    [
        ("statistic", "f8"),  # in standard deviations
        ("gate", "f8"),
        ("p_value", "f8"),  # how often clean readings go so high, per look
        ("anomalous", "?"),
        ("warming", "?"),
    ],
    align=True,
)
