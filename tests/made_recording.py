"""A small road as BSM v1 records: cars one behind the other, one of them with a speed fault for some seconds."""

import math
import random
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

START_US = 1_700_000_000_000_000
METRES_PER_DEGREE = 111_132.0
Fault: TypeAlias = Callable[[float, random.Random], tuple[float, float]]
"""Seconds since its begin, and chance, to what it adds to position (m) and speed (m/s)."""
NORTH_M_PER_DEGREE = 111_080.3
"""Length of a degree of the meridian at 42.3 degrees of WGS 84: 111,132.95 - 559.82 cos(84.6 degrees) m."""
BEGIN, END, AFTER = 600, 1_200, 200


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


def northbound(fault: Fault, rng: random.Random, end: int = END) -> tuple[list[dict[str, Any]], np.ndarray]:
    """Return records of two cars, the second with a fault until tick `end`, and how far north each says it is (m)."""
    records, north_m = [], []
    for tick in range(end + AFTER):
        t_s = tick / 10
        for car, behind_m in (("red", 0.0), ("blue", 25.0)):
            is_faulty = car == "blue" and BEGIN <= tick < end
            off_m, off_mps = fault((tick - BEGIN) / 10, rng) if is_faulty else (0.0, 0.0)
            north_m.append(15.0 * t_s + 20.0 * math.sin(t_s / 8) - behind_m + rng.gauss(0.0, 0.05) + off_m)
            record = {
                "v": 1,
                "id": car,
                "msg_cnt": tick % 128,
                "t_us": START_US + 100_000 * tick,
                "lat": 42.3 + north_m[-1] / NORTH_M_PER_DEGREE,
                "lon": -83.7,
                "speed_mps": 15.0 + 2.5 * math.cos(t_s / 8) + rng.gauss(0.0, 0.03) + off_mps,
                "heading_deg": 0.0,
            }
            records.append(record)
    return records, np.array(north_m)
