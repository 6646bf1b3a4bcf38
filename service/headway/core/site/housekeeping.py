"""What time alone brings about: misses of silent vehicles, and the eviction of those silent for long."""

import numpy as np

from headway.core.site.state import SiteState
from headway.core.tracking import reception
from headway.core.types.batch import I64
from headway.core.types.step_result import StepTally

EVERY_US = 100_000


class Housekeeping:
    """Housekeeping of one site, at most once in `EVERY_US` of local time."""

    def __init__(self, site: SiteState) -> None:
        self._site = site
        self._last_us = 0
        self._pseudonym_changed_us: I64 = np.zeros(site.config.vehicle_capacity, np.int64)
        """(C,) receive time of the last message before a silence that a change of pseudonym explains."""
        self.pairs = 0
        """Vehicles that have a leader; any thread may read it, unlike the tables."""

    def run(self, now_us: int, tally: StepTally) -> None:
        """Start misses and evict vehicles as of local time `now_us`, if it is time to."""
        if now_us - self._last_us < EVERY_US:
            return
        self._last_us = now_us
        rows = self._site.rows()
        leaders = self._site.leaders(rows)
        self._start_misses(rows, leaders, now_us, tally)
        received_us = self._site.tables.tracks["received_us"][rows]
        since_us = np.maximum(received_us, self._site.reception.absent_until_us)
        silent = now_us - since_us > self._site.config.vehicle_ttl_s * 1e6
        if silent.any():
            self._evict(rows[silent], tally)
            leaders = self._site.leaders(self._site.rows())
        self.pairs = int((leaders >= 0).sum())

    def count_pairs(self) -> None:
        """Bring `pairs` up to date between two runs."""
        self.pairs = int((self._site.leaders(self._site.rows()) >= 0).sum())

    def _start_misses(self, rows: I64, leaders: I64, now_us: int, tally: StepTally) -> None:
        site, tracks = self._site, self._site.tables.tracks
        received_us, config = tracks["received_us"], site.config
        ignored = site.misses.active | (self._pseudonym_changed_us == received_us)
        ignored |= received_us < site.reception.outage_until_us
        overdue = reception.overdue(
            tracks,
            site.tables.coverage,
            rows,
            leaders,
            ignored,
            now_us,
            config.silence_timeout_s,
            config.warming_readings,
        )
        for i in np.flatnonzero(overdue):
            row = int(rows[i])
            if reception.pseudonym_changed(tracks, site.first_received_us, row, rows):
                self._pseudonym_changed_us[row] = received_us[row]
            else:
                t_us = int(tracks["t_us"][row])
                tally.events.append(site.misses.start(row, int(leaders[i]), t_us, int(received_us[row])))

    def _evict(self, rows: I64, tally: StepTally) -> None:
        """Evict these rows, and end their misses."""
        site = self._site
        for row in rows[site.misses.active[rows]].tolist():
            track = site.tables.tracks[row]
            tally.events.append(site.misses.end(row, -1, int(track["t_us"]), int(track["received_us"])))
        site.evict(rows)
        tally.evicted += rows.size
