"""A program that receives the alerts of a running service, after those of its history.

Run `python examples/subscriber.py [ENDPOINT]` beside `headway serve`.
"""

import sys

from headway import client
from headway_schemas import Phase
from headway_schemas.query import AlertsQuery


def main(endpoint: str = client.DEFAULT_ENDPOINT, timeout_s: float | None = None) -> None:
    """Print the last ten onsets, then each event update as it comes."""
    past = client.history(AlertsQuery(phase=Phase.ONSET, limit=10), endpoint)
    for event in reversed(past.events):
        print("past", event.kind, event.sensor, event.suspect)
    for event in client.alerts(endpoint, timeout_s=timeout_s):
        print(event.phase, event.kind, event.sensor, event.suspect, f"p = {event.p_value}")


if __name__ == "__main__":
    main(*sys.argv[1:])
