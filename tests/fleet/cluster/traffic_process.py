"""Vehicles of several sites in one process, until standard input ends; prints how many messages each site was sent.

They drive in pairs, as those of `faults.harness.fleet_process`. Some have a wrong location for a second, again and
again.
"""

import argparse
import json
import sys
import threading
import time

import msgpack
import numpy as np
import zenoh
from faults.harness.fleet_process import INTERVAL_S, record
from sim.loopback import session

from headway_schemas import Keys
from headway_schemas.encodings import BSM_MSGPACK


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--endpoint", required=True)
    parser.add_argument("--sites", nargs="+", required=True)
    parser.add_argument("--vehicles", type=int, required=True)
    parser.add_argument("--faulty", type=int, default=4)
    parser.add_argument("--fault-every-s", type=float, default=6.0)
    parser.add_argument("--offset-m", type=float, default=20.0)
    options = parser.parse_args()
    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
    names = [f"car-{car}" for car in range(options.vehicles)]
    keys = {site: [Keys("v2x", site).bsm(name) for name in names] for site in options.sites}
    sent, rng, k = dict.fromkeys(options.sites, 0), np.random.default_rng(0), 0
    with session("client", connect=(options.endpoint,)) as bus:
        start_s, start_us = time.monotonic(), time.time_ns() // 1000
        while not ended.is_set():
            ended.wait(max(0.0, start_s + k * INTERVAL_S - time.monotonic()))
            t_us = start_us + round(k * INTERVAL_S * 1e6)
            is_off = k * INTERVAL_S % options.fault_every_s > options.fault_every_s - 1.0
            for car, name in enumerate(names):
                offset_m = options.offset_m if is_off and car >= options.vehicles - options.faulty else 0.0
                message = msgpack.packb(record(name, car, k, t_us + car, offset_m, rng))
                for site in options.sites:
                    bus.put(
                        keys[site][car], message, encoding=BSM_MSGPACK, congestion_control=zenoh.CongestionControl.BLOCK
                    )
                    sent[site] += 1
            k += 1
    print(json.dumps(sent))


if __name__ == "__main__":
    main()
