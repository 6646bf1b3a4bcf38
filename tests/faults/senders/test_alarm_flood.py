"""Many senders that raise alarms all the time do not displace the events of the others."""

import time
from pathlib import Path

from e2e.serving import KEYS
from faults.harness.processes import Fleet

SENDERS, SECONDS, JOURNAL_MB = 400, 60.0, 10


def test_the_events_of_others_are_kept(start, history, measured, tmp_path: Path) -> None:
    service = start(journal_mb=str(JOURNAL_MB))
    with (
        Fleet(service.endpoint, KEYS.site, cars=4, seconds=SECONDS, faulty=2, prefix="other", until_s=8.0),
        Fleet(
            service.endpoint, KEYS.site, cars=SENDERS, seconds=SECONDS, faulty=SENDERS, prefix="flood",
            fault_s=10.0, fault_every_s=2.0,
        ) as flood,
    ):  # fmt: skip
        flood.sent()
    time.sleep(3.0)
    others = {"other-2", "other-3"}
    found = others & {e.suspect for name in others for e in history(service.endpoint, vehicle=name)}
    updates = service.metric("headway_journal_event_updates_total")[""]
    size_mb = sum(file.stat().st_size for file in (tmp_path / "state").glob("journal.sqlite*")) / 1e6
    got = f"{len(found)} of 2 kept; {updates / SECONDS:.0f} updates a second, {size_mb:.1f} MB"
    measured(f"alarm flood, {SENDERS} senders, {JOURNAL_MB} MB", got, "events of others kept, <= 20 MB")
    assert found == others
    assert size_mb <= 2 * JOURNAL_MB
