"""The identity of this instance."""

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True, kw_only=True)
class Identity:
    """What each event and report carries."""

    site: str
    instance: str
    version: str
    model: str
    config_hash: str
    epoch: int | None = None
    """Number of this service among those of its site, in a fleet."""
    parameters: Mapping[str, float | str] = field(default_factory=dict)
    """All that a verdict depends on except the readings: configuration of the detector, `version`, `core` (digest)."""
