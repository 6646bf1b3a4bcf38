"""What one test between two cars says of one reading; the same record for every such test."""

import numpy as np

CHECK = np.dtype(
    [
        ("statistic", "f8"),  # in standard deviations
        ("gate", "f8"),
        ("p_value", "f8"),  # how often clean readings go so high, per look
        ("lean", "f8"),  # log odds that the follower lies rather than the leader, from these two cars alone
        ("anomalous", "?"),
        ("warming", "?"),
    ],
    align=True,
)
