"""Make the small recording that headway ships: two cars for 40 s; the second one reports a false speed for 8 s.

Run `python examples/make_sample.py FILE.csv.gz`. The same bytes come out each time.
"""

import csv
import gzip
import io
import sys
from pathlib import Path

import numpy as np

START_US = 1_700_000_000_000_000
METRES_PER_DEGREE = 111_132.0
FAULT_S, FAULT_MPS = (25.0, 33.0), 6.0


def main(path: str) -> None:
    """Write the recording."""
    rng = np.random.default_rng(12)
    driven_s = np.arange(-20, 400) * 0.1
    driven_mps = 14.0 - 5.0 * np.exp(-(((driven_s - 16.0) / 4.0) ** 2))
    driven_m = np.cumsum(driven_mps) * 0.1
    t_s, rows = driven_s[20:], []
    for car, delay_s, behind_m in (("car-1", 0.0, 0.0), ("car-2", 1.5, 8.0)):
        v_mps = np.interp(t_s - delay_s, driven_s, driven_mps) + rng.normal(0.0, 0.03, t_s.size)
        north_m = np.interp(t_s - delay_s, driven_s, driven_m) - behind_m + rng.normal(0.0, 0.03, t_s.size)
        if car == "car-2":
            v_mps[(t_s >= FAULT_S[0]) & (t_s < FAULT_S[1])] += FAULT_MPS
        for k in range(t_s.size):
            t_us = START_US + round(t_s[k] * 1e6) + (30_000 if car == "car-2" else 0)
            lat, speed = 42.28 + north_m[k] / METRES_PER_DEGREE, round(v_mps[k] / 0.02) * 0.02
            rows.append((car, k % 128, t_us, f"{lat:.7f}", "-83.7432", f"{speed:.2f}", 0))
    rows.sort(key=lambda row: (row[2], row[0]))
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("id", "msg_cnt", "t_us", "lat", "lon", "speed_mps", "heading_deg"))
    writer.writerows(rows)
    Path(path).write_bytes(gzip.compress(text.getvalue().encode(), mtime=0))


if __name__ == "__main__":
    main(sys.argv[1])
