"""Recordings as what the load generator replays."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any, Final

from headway.cli.run.recorded.refusals import Reading, Refusals
from headway.feeds.refusal import MALFORMED, UNAVAILABLE, Refusal
from headway.gateways.recordings.formats import AUTO, Located, open_recordings, recognised
from headway.gateways.recordings.reader import RecordingError
from headway_loadtest.sources import SourceError
from headway_schemas.bsm import NEEDED
from headway_schemas.fields import T_US_MAX
from headway_schemas.keys import is_id

_AHEAD: Final = "datafronttargets"
"""Of Safety Pilot: with this table beside DataWsu the load generator adds the vehicles ahead."""
_NUMBERS: Final = ("lat", "lon", "speed_mps", "heading_deg", "accel_mps2", "accuracy_m", "length_m", "msg_cnt")


def is_recorded(reading: Reading) -> bool:
    """Whether the sources are recordings that the gateways read, rather than drives of the load generator.

    Raises
    ------
    SourceError
        Some are and some are not.
    """
    if reading.form != AUTO or reading.columns is not None:
        return True
    recorded = [_is_recording(word) for word in reading.sources]
    if any(recorded) and not all(recorded):
        raise SourceError("recordings are replayed by themselves: leave the other sources out")
    return all(recorded)


def _is_recording(word: str) -> bool:
    path = Path(word)
    if path.is_dir():
        return not any(_AHEAD in file.name.lower() for file in path.iterdir())
    if not path.is_file():
        return False
    try:
        return recognised(word) is not None
    except RecordingError as error:
        raise SourceError(str(error)) from None


@dataclass(slots=True)
class RecordedRows:
    """Records of recordings with the name of their drive; what is refused is printed the first time."""

    reading: Reading
    shown: bool = False

    def __call__(self) -> Iterator[tuple[str, dict[str, Any]]]:
        """Yield the records from the beginning."""
        return ((located.drive, located.record) for located in self.located() if located.record)

    def located(self) -> Iterator[Located]:
        """Yield the records from the beginning, and rows of ground truth."""
        refusals = Refusals()
        try:
            with open_recordings(self.reading.sources, self.reading.form, self.reading.columns) as recordings:
                for located in chain.from_iterable(recordings.chunks):
                    if located.refusal is not None:
                        refusals.add(located, *located.refusal)
                    elif located.record and (problem := _problem(located.record)) is not None:
                        refusals.add(located, *problem)
                    else:
                        yield located
        except RecordingError as error:
            raise SourceError(str(error)) from None
        if not self.shown:
            self.shown = True
            refusals.show()


def _problem(record: dict[str, Any]) -> Refusal | None:
    """Return why a record cannot be sent: a value is missing, or of another type. Ranges are the service's business."""
    missing = next((name for name in NEEDED if record.get(name) is None), None)
    if missing is not None:
        return Refusal(UNAVAILABLE, f"{missing}: no value")
    wrong = next((name for name in _NUMBERS if type(record.get(name, 0)) not in (int, float, type(None))), None)
    if type(record["id"]) is not str or not is_id(record["id"]):
        wrong = "id"
    elif type(record["t_us"]) is not int or not 0 <= record["t_us"] <= T_US_MAX:
        wrong = "t_us"
    return None if wrong is None else Refusal(MALFORMED, f"{wrong}: not a value of its kind")
