"""A subscriber of alerts in a process of its own: a JSON line for each, with when it came.

It may stop taking any, or ask the history for what a gap in the sequence shows.
"""

import argparse
import json
import sys
import threading
import time

import zenoh

from headway.client import alerts


def show(alert: dict) -> None:
    print(json.dumps({"received_us": time.time_ns() // 1000, **alert}), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--endpoint", required=True)
    parser.add_argument("--site", required=True)
    parser.add_argument("--stall-after", type=int, default=None, help="alerts taken before it takes no more")
    parser.add_argument("--catch-up", action="store_true", help="ask the history for what was missed")
    options = parser.parse_args()

    if options.catch_up:
        print(json.dumps({"ready": True}), flush=True)
        for event in alerts(options.endpoint, site=options.site):
            show(event.model_dump(mode="json", exclude={"evidence"}))

    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([options.endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    if options.stall_after is not None:  # so that what the kernel buffers for it is soon used up
        config.insert_json5("transport/link/tcp/so_rcvbuf", "65536")
    count = 0

    def take(sample: zenoh.Sample) -> None:
        nonlocal count
        count += 1
        if options.stall_after is not None and count > options.stall_after:
            threading.Event().wait()
        alert = json.loads(sample.payload.to_bytes())
        alert.pop("evidence", None)
        show(alert)

    session = zenoh.open(config)
    session.declare_subscriber(f"v2x/{options.site}/alert/**", take)
    print(json.dumps({"ready": True}), flush=True)
    sys.stdin.read()  # until the parent closes it


if __name__ == "__main__":
    main()
