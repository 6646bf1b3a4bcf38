"""Who judges a reading: the filter of the model, and the tests between two cars. What both keep is a bank row."""

from dataclasses import dataclass, replace

import numpy as np

from headway.core.consistency.pair_tests import LINK, LinkParams, link_params
from headway.core.estimation import registry
from headway.core.types.config import DetectorConfig

LINK_SHARE = 0.5
"""Of the alarm budget, what the tests between two cars may spend; the rest is the filter's."""


@dataclass(frozen=True, slots=True)
class Judges:
    """Everything that a verdict depends on beside the row and the reading."""

    model: registry.Model
    link_params: LinkParams
    dtype: np.dtype[np.void]
    """Row of the bank: `model`, the filter's part, and `link`."""


def judges(config: DetectorConfig) -> Judges:
    """Return the judges that `config` asks for; KeyError for an unknown model."""
    model = registry.build(replace(config, alarm_budget_per_hour=(1.0 - LINK_SHARE) * config.alarm_budget_per_hour))
    return Judges(
        model=model,
        link_params=link_params(LINK_SHARE * config.alarm_budget_per_hour),
        dtype=np.dtype([("model", model.dtype), ("link", LINK)]),
    )
