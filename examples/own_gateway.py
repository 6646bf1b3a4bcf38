"""A gateway for a feed of your own: lines `id;seconds;lat;lon;km/h` in, BSM v1 on zenoh out.

Run `some-feed | python examples/own_gateway.py [ENDPOINT]` beside `headway serve`. A gateway has a key of its own,
which begins with `gw-`; its payloads hold messages of any senders.
"""

import json
import sys
from collections import Counter
from collections.abc import Iterable

import zenoh

from headway_schemas import Keys
from headway_schemas.bsm import from_map, to_map
from headway_schemas.encodings import BSM_JSON


def main(endpoint: str = "tcp/127.0.0.1:7447", lines: Iterable[str] = sys.stdin) -> None:
    """Publish a message for each line."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    counts: Counter[str] = Counter()
    with zenoh.open(config) as session:
        publisher = session.declare_publisher(Keys("v2x", "local").bsm("gw-example"), encoding=BSM_JSON)
        for line in lines:
            vehicle, seconds, lat, lon, kmh = line.split(";")
            fields = {"v": 1, "id": vehicle, "msg_cnt": counts[vehicle] % 128, "t_us": round(float(seconds) * 1e6)}
            position = {"lat": float(lat), "lon": float(lon), "speed_mps": float(kmh) / 3.6}
            counts[vehicle] += 1
            publisher.put(json.dumps(to_map(from_map(fields | position))))


if __name__ == "__main__":
    main(*sys.argv[1:])
