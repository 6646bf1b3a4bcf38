"""The view of a site for the quality topic: what its vehicles' sensors are like."""

import numpy as np

from headway.core.site.state import SiteState
from headway.core.types.sensor_quality import QualityStates, quality_levels


def quality_states(site: SiteState, stride: int, phase: int) -> QualityStates | None:
    """Return the vehicles whose row is `phase` modulo `stride`; None where the model learns nothing of sensors."""
    if site.model.sensor_qualities is None:
        return None
    rows = site.owned_rows(stride, phase)
    bank = site.tables.bank[rows]
    qualities = site.model.sensor_qualities(bank["model"])
    known = np.isfinite(qualities.position_noise_m)
    rows, qualities = rows[known], qualities.of(known)
    return QualityStates(
        vehicles=[str(site.vehicles.id_of[row]) for row in rows],
        t_us=site.tables.tracks["t_us"][rows],
        levels=quality_levels(qualities, bank["plausibility"]["observed"][known]),
        qualities=qualities,
    )
