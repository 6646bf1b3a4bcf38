"""zenoh on loopback: a free address, and sessions that reach no other peer."""

import json
import socket

import zenoh


def free_endpoint() -> str:
    """Return an endpoint without a listener."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def session(mode: str, *, connect: tuple[str, ...] = (), listen: tuple[str, ...] = ()) -> zenoh.Session:
    """Open a session without scouting."""
    config = zenoh.Config()
    for key, value in (
        ("mode", mode),
        ("connect/endpoints", connect),
        ("listen/endpoints", listen),
        ("scouting/multicast/enabled", False),
        ("scouting/gossip/enabled", False),
    ):
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)
