"""Recordings of other systems, and their ground truth, for `headway evaluate field`."""

from collections.abc import Iterator
from pathlib import Path

from headway.cli.run.recorded.refusals import Reading
from headway.cli.run.recorded.scenes import RecordedRows
from headway.gateways.recordings.formats import BSM, recognised
from headway.gateways.recordings.reader import RecordingError
from headway_loadtest.evaluate.field.recordings import Row


class FieldReader:
    """Recordings of other systems, for `headway evaluate field`; its own formats it reads itself."""

    def recognises(self, path: Path) -> bool:
        """Whether the first bytes tell such a recording; a file that cannot be opened is none."""
        try:
            return recognised(str(path)) not in (None, BSM, "gnss")
        except RecordingError:
            return False

    def rows(self, path: Path) -> Iterator[Row]:
        """Yield the records and the ground truth; raises `SourceError`."""
        for located in RecordedRows(Reading([str(path)])).located():
            yield Row(located.drive, located.record, *(located.truth or ()))
