"""What time alone brings about: misses of silent vehicles, and the eviction of those silent for long."""

import numpy as np

from headway.core.site.state import SiteState
from headway.core.tracking import reception
from headway.core.types.batch import I64
from headway.core.types.step_result import AnomalyEvent, StepTally


class Housekeeping:
    """Housekeeping of one site."""

    def __init__(self, site: SiteState) -> None:
        self._site = site
        self._pseudonym_changed_us: I64 = np.zeros(site.config.vehicle_capacity, np.int64)
        """(C,) receive time of the last message before a silence that a change of pseudonym explains."""
        self.pairs = 0
        """Vehicles that have a leader; any thread may read it, unlike the tables."""

    def run(self, now_us: int, tally: StepTally) -> None:
        """Start misses and evict vehicles as of local time `now_us`."""
        rows = self._site.rows()
        leaders = self._site.leaders(rows)
        self._start_misses(rows, leaders, now_us, tally)
        received_us = self._site.tables.tracks["received_us"][rows]
        since_us = np.maximum(received_us, self._site.reception.absent_until_us)
        silent = now_us - since_us > self._site.config.vehicle_ttl_s * 1e6
        if silent.any():
            self._evict(rows[silent], now_us, tally)
            rows = self._site.rows()
            leaders = self._site.leaders(rows)
        self.pairs = int(((leaders >= 0) & self._site.tables.owned[rows]).sum())

    def count_pairs(self) -> None:
        """Bring `pairs` up to date between two runs."""
        self.pairs = int((self._site.leaders(self._site.owned_rows()) >= 0).sum())

    def _start_misses(self, rows: I64, leaders: I64, now_us: int, tally: StepTally) -> None:
        site, tracks = self._site, self._site.tables.tracks
        received_us, config = tracks["received_us"], site.config
        last_us = received_us[rows]
        ignored = site.misses.active[rows] | (self._pseudonym_changed_us[rows] == last_us)
        ignored |= last_us < site.reception.outage_until_us
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
                miss = site.misses.start(row, int(leaders[i]), t_us, int(received_us[row]), now_us)
                tally.events += site.published([miss])

    def _evict(self, rows: I64, now_us: int, tally: StepTally) -> None:
        """Evict these rows, and clear the open events that concern them."""
        site = self._site
        t_us, received_us = site.tables.tracks["t_us"], site.tables.tracks["received_us"]
        ended: list[AnomalyEvent] = []
        for log in (site.events, site.pair_events):
            of = log.of(rows) if len(log) else ()
            ended += [log.end(row, int(t_us[row]), int(received_us[row]), now_us) for row in of]
        silent = rows[site.misses.active[rows]].tolist()
        ended += [site.misses.end(row, -1, int(t_us[row]), int(received_us[row]), now_us) for row in silent]
        tally.events += site.published(ended)
        tally.evicted += int(site.tables.owned[rows].sum())
        site.evict(rows)
