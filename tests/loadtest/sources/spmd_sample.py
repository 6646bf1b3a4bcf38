"""Drives in the format of the public SPMD files: the same files for a seed.

Each trip is one host behind one leader, both out of the synthetic fleet. The host's radar also sees what is not ahead
of it (the next lane, a pedestrian), and in one trip of four it loses the leader for a while and finds it again under
another number, as real radars do.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from headway_loadtest.sources.drive import Drive
from headway_loadtest.sources.spmd import CENTISECONDS, HOST_COLUMNS, KMH, TARGET_COLUMNS
from headway_loadtest.sources.synthetic import PLATOON, drives

HOST_FILE, TARGETS_FILE = "sample_DataWsu.csv", "sample_DataFrontTargets.csv"
FIRST_DEVICE = 20_001
GPS_TIME_MS = 1_350_000_000_000
CARS = 3
"""In a platoon: the last one is the host, the one before it is its leader."""
RADAR_LSB = 1 / 144
BLIND_S = 3.0


def write_sample(folder: Path, *, pairs: int, seconds: float, seed: int = 0) -> None:
    """Write the two tables, `pairs` trips of so many seconds each, into a folder that exists."""
    with (folder / HOST_FILE).open("w", encoding="ascii") as hosts, (folder / TARGETS_FILE).open("w") as targets:
        hosts.write(",".join(HOST_COLUMNS) + "\n")
        targets.write(",".join(TARGET_COLUMNS) + "\n")
        for number in range(pairs):
            _, leader, host = drives(CARS, seconds, seed, first=number * PLATOON, window_ms=(0, 0))
            hosts.writelines(_host_rows(FIRST_DEVICE + number, host))
            targets.writelines(_target_rows(FIRST_DEVICE + number, number, host, leader))


def _host_rows(device: int, host: Drive) -> Iterator[str]:
    accel_mps2 = np.gradient(host.speed_mps, host.t_s)
    yaw_dps = np.gradient(np.degrees(np.unwrap(np.radians(host.heading_deg))), host.t_s)
    for i in range(len(host.t_s)):
        time = round(host.t_s[i] * CENTISECONDS)
        yield (
            f"{device},1,{time},1,{GPS_TIME_MS + 10 * time},{host.lat[i]:.6f},{host.lon[i]:.6f},262.40,"
            f"{host.heading_deg[i]:.4f},{host.speed_mps[i]:.4f},0.9,1.5,1,0,1,{yaw_dps[i]:.4f},"
            f"{host.speed_mps[i] * KMH:.4f},0,0,0,{accel_mps2[i]:.4f},5,0,0,0,0,0\n"
        )


def _target_rows(device: int, number: int, host: Drive, leader: Drive) -> Iterator[str]:
    length_m = leader.length_m or 0.0
    range_m = np.round((leader.x_m - host.x_m - length_m) / RADAR_LSB) * RADAR_LSB
    range_rate_mps = np.round((leader.speed_mps - host.speed_mps) / RADAR_LSB) * RADAR_LSB
    middle_s = float(host.t_s[-1]) / 2
    for i in range(len(host.t_s)):
        head = f"{device},1,{round(host.t_s[i] * CENTISECONDS)}"
        after = number % 4 == 3 and host.t_s[i] > middle_s
        if not (after and host.t_s[i] < middle_s + BLIND_S):
            yield f"{head},1,{3 + after},{range_m[i]:.6f},{range_rate_mps[i]:.6f},-0.312500,0,3,1\n"
        yield f"{head},2,9,{range_m[i] + 22.5:.6f},{range_rate_mps[i] + 1.5:.6f},3.375000,1,3,0\n"
        yield f"{head},3,12,{8.0 + i % 50:.6f},{-host.speed_mps[i]:.6f},-4.125000,3,1,0\n"
