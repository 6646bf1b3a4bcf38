"""Events as misbehaviour reports in the terms of ETSI TS 103 759, in JSON.

A report names what the standard names: targets and observations, time and application. Observations without a known
number stand beside it under `headway`. The original messages are not kept, so `v2xPduEvidence` is empty. The report is
not signed.
"""

import json
from collections.abc import Iterable
from typing import IO, Any, Final

ITS_EPOCH_US: Final = 1_072_915_200_000_000
"""2004-01-01 in Unix time."""
LEAP_SECONDS_US: Final = 5_000_000
"""Since then. The time of a report is TAI, which counts them."""
AID_CA_BSM: Final = 32
"""PSID of the basic safety message."""
_VERSION: Final = 1
_UNKNOWN_PLACE: Final = {"latitude": 900_000_001, "longitude": 1_800_000_001, "elevation": 61_440}
"""An event has a place along the road, none on the globe."""

_NAMED: Final = {
    "interval": (0, 1, "Beacon-IntervalTooSmall"),
    "position_change": (3, 4, "Position-ChangeTooLarge"),
    "speed_change": (4, 5, "Speed-ChangeTooLarge"),
    "acceleration": (5, 4, "LongAcc-ValueTooLarge"),
}
"""Our observation: target, observation, and its name in the standard."""
_LOCAL_FIELDS: Final = (
    "event_id", "phase", "kind", "sensor", "suspect", "leader", "follower", "site", "etsi_target", "observations",
    "statistic", "gate", "p_value", "confidence", "model", "config_hash",
)  # fmt: skip


def report_of(event: dict[str, Any]) -> dict[str, Any]:
    """Return the report of one event update, in its JSON form."""
    by_target: dict[int, list[dict[str, Any]]] = {}
    for observation in event["observations"]:
        if observation in _NAMED:
            target, number, name = _NAMED[observation]
            by_target.setdefault(target, []).append({"obsId": number, "obs": name})
    content = {
        "observations": [{"tgtId": target, "observations": found} for target, found in sorted(by_target.items())],
        "v2xPduEvidence": [],
        "nonV2xPduEvidence": [],
    }
    return {
        "version": _VERSION,
        "generationTime": event["detected_us"] - ITS_EPOCH_US + LEAP_SECONDS_US,
        "observationLocation": _UNKNOWN_PLACE,
        "report": {"aid": AID_CA_BSM, "content": content},
        "headway": {name: event.get(name) for name in _LOCAL_FIELDS},
    }


def write_reports(stored: Iterable[bytes], to: IO[bytes]) -> int:
    """Write a report for each onset and update, a line of JSON; the end of an event is none. Return how many."""
    count = 0
    for line in stored:
        event = json.loads(line)
        if event["phase"] != "cleared":
            to.write(json.dumps(report_of(event)).encode() + b"\n")
            count += 1
    return count
