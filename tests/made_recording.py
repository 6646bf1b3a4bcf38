"""A small road as BSM v1 records: cars one behind the other, one of them with a speed fault for some seconds."""

from typing import Any

import numpy as np

START_US = 1_700_000_000_000_000
METRES_PER_DEGREE = 111_132.0


def made_recording(
    cars: int = 4, seconds: float = 20.0, *, fault: tuple[float, float] | None = (10.0, 14.0), seed: int = 1
) -> list[dict[str, Any]]:
    """Return records in the order of reception; car1 says 8 m/s too much while `fault`, s, lasts."""
    rng = np.random.default_rng(seed)
    records = []
    for k in range(round(seconds * 10)):
        t_s = 0.1 * k
        for car in range(cars):
            speed_mps = 15.0 + 2.0 * np.sin(0.3 * t_s - 0.2 * car)
            x_m = 15.0 * t_s - 2.0 / 0.3 * np.cos(0.3 * t_s - 0.2 * car) - 30.0 * car + rng.normal(0, 0.05)
            if car == 1 and fault is not None and fault[0] <= t_s < fault[1]:
                speed_mps += 8.0
            t_us = START_US + 100_000 * k + 7_000 * car
            records.append(
                {
                    "v": 1,
                    "id": f"car{car}",
                    "msg_cnt": k % 128,
                    "t_us": t_us,
                    "received_us": t_us + int(rng.integers(5_000, 60_000)),
                    "lat": round(42.0 + x_m / METRES_PER_DEGREE, 7),
                    "lon": -83.0,
                    "speed_mps": round(float(speed_mps + rng.normal(0, 0.05)), 2),
                    "heading_deg": 0.0,
                }
            )
    return sorted(records, key=lambda record: record["received_us"])
