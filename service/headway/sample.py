"""A small recording to try things on: two cars for 40 s, the second one with a false speed for 8 s."""

from pathlib import Path
from typing import Any

from headway.gateways.recordings.formats import open_recordings


def sample_recording() -> list[dict[str, Any]]:
    """Return the records, in the order of reception.

    Examples
    --------
    >>> records = sample_recording()
    >>> len(records), sorted({record["id"] for record in records})
    (800, ['car-1', 'car-2'])
    """
    with open_recordings([str(Path(__file__).with_name("sample.csv.gz"))]) as recordings:
        return [located.record for chunk in recordings.chunks for located in chunk]
