"""Evidence to the wire and back."""

from dataclasses import asdict, fields
from typing import Final

import numpy as np

from headway.core.replay import bank_row
from headway.core.runtime import rows as banks
from headway.core.types.config import DetectorConfig
from headway.core.types.records import READING
from headway.core.types.step_result import Evidence
from headway.edge.identity import Identity
from headway_schemas import event as wire

_READING: Final = READING.names or ()
_LEADER: Final = "leader_row"


def parameters(config: DetectorConfig, version: str, core: str) -> dict[str, float | str]:
    """Return all that a verdict depends on except the readings; `core` is the digest of the sources of the core."""
    of = {name: value if isinstance(value, str) else float(value) for name, value in asdict(config).items()}
    return {**of, "version": version, "core": core}


def to_wire(evidence: Evidence, identity: Identity, messages: tuple[wire.OriginalMessage, ...] = ()) -> wire.Evidence:
    """Return what is needed to compute the verdict again, and the messages themselves.

    Its hundreds of numbers are our own; validating them would be most of the cost of an event.
    """
    numbers = np.column_stack([*(evidence.readings[name] for name in _READING), evidence.leaders])
    table = numbers.astype(np.object_)
    table[~np.isfinite(numbers)] = None
    return wire.Evidence.model_construct(
        columns=(*_READING, _LEADER),
        readings=tuple(map(tuple, table.tolist())),
        messages=messages,
        checkpoint=evidence.checkpoint.tobytes(),
        parameters=dict(identity.parameters),
    )


def from_wire(evidence: wire.Evidence) -> tuple[Evidence, DetectorConfig]:
    """Return what `to_wire` was given, and the configuration of the verdict.

    Raises
    ------
    ValueError
        This version cannot read it: a column, a parameter or the checkpoint is missing or invalid.
    """
    absent = {*_READING, _LEADER} - set(evidence.columns)
    absent |= {field.name for field in fields(DetectorConfig)} - set(evidence.parameters)
    if absent or evidence.checkpoint is None:
        raise ValueError(f"evidence without {', '.join(sorted(absent)) or 'checkpoint'}")
    table = np.array(evidence.readings, float).reshape(-1, len(evidence.columns))
    readings = banks.readings(len(table))
    for name in _READING:
        readings[name] = table[:, evidence.columns.index(name)]
    config = _config(evidence.parameters)
    return Evidence(
        checkpoint=bank_row(evidence.checkpoint, config),
        readings=readings,
        leaders=table[:, evidence.columns.index(_LEADER)].astype(np.int64),
    ), config


def _config(parameters: dict[str, float | str | None]) -> DetectorConfig:
    """Return the configuration with each number of its own type, which JSON does not keep."""
    default = DetectorConfig()
    types = {field.name: type(getattr(default, field.name)) for field in fields(default)}
    try:
        return DetectorConfig(**{name: of(parameters[name]) for name, of in types.items()})
    except TypeError:
        raise ValueError("a parameter is null") from None
