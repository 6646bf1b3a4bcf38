"""Two motion models on the same recording: faulty records found, false alarms, and the delay of the first alarm.

Run `python examples/evaluate_model.py [MODEL ...]`. The fault of the sample recording is known: `make_sample.py`.
"""

import sys

import numpy as np

from headway import Detector, sample_recording

FAULT_S = (25.0, 33.0)


def main(*models: str) -> None:
    """Print one line for each model."""
    records = sample_recording()
    t_s = np.array([record["t_us"] for record in records]) / 1e6
    t_s -= t_s[0]
    second = np.array([record["id"] == "car-2" for record in records])
    faulty = second & (t_s >= FAULT_S[0]) & (t_s < FAULT_S[1] + 0.03)
    print("model     recall  false alarms  delay, s")
    for model in models or ("headway", "ekf"):
        verdicts = Detector(model=model).process(records).verdicts
        alarms = verdicts["anomalous"] & (verdicts["outcome"] == "scored")
        found = t_s[alarms & faulty]
        delay = f"{found[0] - FAULT_S[0]:8.2f}" if found.size else "   never"
        print(f"{model:<8}  {alarms[faulty].mean():6.2f}  {alarms[~faulty].sum():12d}  {delay}")


if __name__ == "__main__":
    main(*sys.argv[1:])
