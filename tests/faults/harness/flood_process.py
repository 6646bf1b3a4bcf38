"""One sender at full speed, in a process of its own; prints how many messages it sent."""

import argparse
import json
import time

import msgpack
import zenoh

from headway_schemas import Keys
from headway_schemas.encodings import BSM_MSGPACK

NAME = "flood"
TOO_OLD_US = 10_000_000
"""Records are so old that none is judged: what is judged is of the others."""


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--endpoint", required=True)
    parser.add_argument("--site", required=True)
    parser.add_argument("--seconds", type=float, required=True)
    parser.add_argument("--payload-bytes", type=int, default=0, help="of each message; 0: a valid record")
    options = parser.parse_args()
    config = zenoh.Config()
    for key, value in (
        ("mode", "client"),
        ("connect/endpoints", [options.endpoint]),
        ("scouting/multicast/enabled", False),
    ):
        config.insert_json5(key, json.dumps(value))
    key, sent = Keys("v2x", options.site).bsm(NAME), 0
    with zenoh.open(config) as session:
        until_s = time.monotonic() + options.seconds
        while time.monotonic() < until_s:
            record = [1, NAME, sent % 128, time.time_ns() // 1000 - TOO_OLD_US, 42.5, -83.5, 15.0, 0.0]
            payload = bytes(options.payload_bytes) or msgpack.packb(record)
            session.put(key, payload, encoding=BSM_MSGPACK, congestion_control=zenoh.CongestionControl.BLOCK)
            sent += 1
    print(sent)


if __name__ == "__main__":
    main()
