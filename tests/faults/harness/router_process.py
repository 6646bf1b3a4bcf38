"""A zenoh router with a configuration file of `deploy/zenoh`, listening on an endpoint, in a process of its own."""

import json
import sys

import zenoh


def main() -> None:
    endpoint, file = sys.argv[1:]
    config = zenoh.Config.from_file(file)
    config.insert_json5("listen/endpoints", json.dumps([endpoint]))
    with zenoh.open(config):
        print("ready", flush=True)
        sys.stdin.read()  # until the parent closes it


if __name__ == "__main__":
    main()
