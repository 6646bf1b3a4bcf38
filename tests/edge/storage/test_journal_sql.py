"""The journal for tools that read SQL."""

import json
import sqlite3
import zlib
from contextlib import closing
from pathlib import Path

from edge.storage.updates import update
from sim.rig import IDENTITY

from headway.core.types.step_result import Phase
from headway.edge.storage.journal import Journal


def test_the_tools_of_others_read_an_event_a_row_and_valid_json(tmp_path: Path) -> None:
    onset, path = update(1, event_id="e1"), tmp_path / "journal.sqlite"
    Journal(path, site=IDENTITY.site, instance=IDENTITY.instance, days=30.0, megabytes=100.0).write(
        [onset, update(2, event_id="e1", phase=Phase.UPDATE, evidence=None), update(3, event_id="e2")]
    )
    with closing(sqlite3.connect(path)) as db:
        shown = "SELECT event_id, phase, statistic, json_extract(json, '$.suspect') = suspect FROM events ORDER BY t_us"
        assert db.execute(shown).fetchall() == [
            ("e1", "update", onset.event.statistic, 1),
            ("e2", "onset", onset.event.statistic, 1),
        ]
        assert db.execute(
            "SELECT min(json_valid(event)), min(json_valid(parameters)) FROM details, configs"
        ).fetchone() == (1, 1)
        (readings,) = db.execute("SELECT readings FROM evidence LIMIT 1").fetchone()
    assert onset.event.evidence is not None
    read = json.loads(zlib.decompress(readings))
    assert tuple(read["columns"]) == onset.event.evidence.columns
    assert len(read["readings"]) == len(onset.event.evidence.readings)
