"""The detector on a data frame: a verdict for each row, and the events.

Run `python examples/data_frame.py [PICTURE.png]`.
"""

import sys

import polars as pl

from headway import Detector, sample_recording


def main(picture: str | None = None) -> None:
    """Judge the sample recording and print what is found."""
    frame = pl.DataFrame(sample_recording())
    detector = Detector(alarm_budget_per_hour=1.0, delay_s=0.5)
    result = detector.process(frame)
    judged = pl.concat([frame.select("id", "t_us", "speed_mps"), pl.DataFrame(result.verdicts)], how="horizontal")
    print(judged.group_by("id", "outcome", "anomalous").len().sort("id", "outcome", "anomalous"))
    for event in [*result.events, *detector.finish().events]:
        print(event.phase, event.kind, event.sensor, event.suspect, event.t_us)
    if picture is not None:
        result.plot("car-2").savefig(picture)


if __name__ == "__main__":
    main(*sys.argv[1:])
