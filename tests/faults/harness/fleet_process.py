"""Cars that send ten times a second, in a process of their own; prints how many messages each sent.

The time of a message is that at which the car was there. On a busy machine it is sent late, as on a busy channel.
Cars drive in pairs, 30 m apart, each pair on a road of its own: car-0 leads car-1, car-2 leads car-3.
"""

import argparse
import heapq
import json
import time

import msgpack
import numpy as np
import zenoh

from headway_schemas import Keys
from headway_schemas.encodings import BSM_MSGPACK

M_PER_DEG = 111_083.0
GAP_M, SPEED_MPS, NOISE_M, NOISE_MPS = 30.0, 15.0, 0.02, 0.02
INTERVAL_S = 0.1
ROADS_APART_DEG = 0.01


def record(name: str, car: int, k: int, t_us: int, offset_m: float, rng: np.random.Generator) -> list[object]:
    """Return message `k` of a car as a compact record, its place off by `offset_m`."""
    x_m = SPEED_MPS * INTERVAL_S * k - GAP_M * (car % 2) + offset_m + rng.normal(0.0, NOISE_M)
    lat = 42.0 + x_m / M_PER_DEG
    lon = -83.0 + ROADS_APART_DEG * (car // 2)
    speed_mps = SPEED_MPS + rng.normal(0.0, NOISE_MPS)
    return [1, name, k % 128, t_us, lat, lon, speed_mps, 0.0, None, None, None, 4.5]


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--endpoint", required=True)
    parser.add_argument("--site", required=True)
    parser.add_argument("--cars", type=int, required=True)
    parser.add_argument("--seconds", type=float, required=True)
    parser.add_argument("--faulty", type=int, default=0, help="so many of the last cars, from --fault-s on")
    parser.add_argument("--fault-s", type=float, default=5.0)
    parser.add_argument("--fault-every-s", type=float, default=float("inf"), help="a second of fault each time")
    parser.add_argument("--offset-m", type=float, default=20.0)
    parser.add_argument("--until-s", type=float, default=float("inf"), help="no fault from then on")
    parser.add_argument("--late-s", type=float, default=0.0, help="each message is sent up to so much later")
    parser.add_argument("--prefix", default="car", help="of the ids")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()

    config = zenoh.Config()
    for key, value in (
        ("mode", "client"),
        ("connect/endpoints", [options.endpoint]),
        ("scouting/multicast/enabled", False),
        ("scouting/gossip/enabled", False),
    ):
        config.insert_json5(key, json.dumps(value))
    keys, rng = Keys("v2x", options.site), np.random.default_rng(options.seed)
    names = [f"{options.prefix}-{car}" for car in range(options.cars)]
    sent, late, air = dict.fromkeys(names, 0), round(options.late_s / INTERVAL_S), []
    with zenoh.open(config) as session:
        start_s, start_us = time.monotonic(), time.time_ns() // 1000
        steps = round(options.seconds / INTERVAL_S)
        for k in range(steps + late):
            time.sleep(max(0.0, start_s + k * INTERVAL_S - time.monotonic()))
            since_s = k * INTERVAL_S - options.fault_s
            is_off = since_s >= 0.0 and since_s % options.fault_every_s < 1.0 and k * INTERVAL_S < options.until_s
            t_us = start_us + round(k * INTERVAL_S * 1e6)
            for car, name in enumerate(names) if k < steps else ():
                offset_m = options.offset_m if is_off and car >= options.cars - options.faulty else 0.0
                message = msgpack.packb(record(name, car, k, t_us + car, offset_m, rng))
                heapq.heappush(air, (k + (int(rng.integers(late + 1)) if late else 0), k, car, message))
            while air and air[0][0] <= k:
                _, _, car, message = heapq.heappop(air)
                name = names[car]
                session.put(
                    keys.bsm(name), message, encoding=BSM_MSGPACK, congestion_control=zenoh.CongestionControl.BLOCK
                )
                sent[name] += 1
    print(json.dumps(sent))


if __name__ == "__main__":
    main()
