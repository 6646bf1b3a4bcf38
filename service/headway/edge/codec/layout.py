"""Compact records as columns, and which of them the model would accept, without a call of the model for each.

The limits are read off the model, so the two agree; a test compares them.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from headway.core.types.batch import F64
from headway_schemas.fields import Message

_ABSENT: Final = type(None)
_TYPES: Final[dict[str, frozenset[type]]] = {"integer": frozenset({int}), "number": frozenset({int, float})}
"""Number types of JSON Schema and the Python types that they accept; a boolean is no number."""


@dataclass(frozen=True, slots=True)
class Table:
    """B records as columns by field name."""

    cells: dict[str, Sequence[Any]]
    """(B,) for each field that is no number, as the sender sent it."""
    numbers: dict[str, F64]
    """(B,) for each field that is a number, NaN where it is null."""
    good: NDArray[np.bool_]
    """(B,) whether every number is one that the model accepts."""


@dataclass(frozen=True, slots=True)
class Layout:
    """The fields of a compact record in order, and the limits of its K numbers."""

    fields: tuple[str, ...]
    kinds: dict[str, frozenset[type]]
    """Types of each number, with NoneType where it may be null."""
    low: F64
    """(K, 1), inclusive."""
    high: F64
    """(K, 1), inclusive."""
    nullable: NDArray[np.bool_]
    """(K, 1)"""

    @classmethod
    def of(cls, model: type[Message]) -> Self:
        """Read the layout off a model."""
        properties = model.model_json_schema()["properties"]
        kinds: dict[str, frozenset[type]] = {}
        lows, highs = [], []
        for name, schema in properties.items():
            number, *null = schema.get("anyOf", [schema])
            types = _TYPES.get(number.get("type"))
            if types is None:
                continue
            kinds[name] = types | {_ABSENT} if null else types
            lows.append(number.get("minimum", np.nextafter(number.get("exclusiveMinimum", 0.0), math.inf)))
            highs.append(number.get("maximum", np.nextafter(number.get("exclusiveMaximum", 0.0), -math.inf)))
        return cls(
            fields=tuple(properties),
            kinds=kinds,
            low=np.array(lows, dtype=np.float64)[:, np.newaxis],
            high=np.array(highs, dtype=np.float64)[:, np.newaxis],
            nullable=np.array([_ABSENT in k for k in kinds.values()])[:, np.newaxis],
        )

    def table(self, records: Sequence[Sequence[Any]]) -> Table:
        """Turn records, each a sequence of at most as many values as there are fields, into columns."""
        columns: list[tuple[Any, ...]] = list(zip_longest(*records))
        columns += [(None,) * len(records)] * (len(self.fields) - len(columns))
        cells: dict[str, Sequence[Any]] = dict(zip(self.fields, columns, strict=True))
        values = self._values([cells.pop(name) for name in self.kinds])
        within = ((values >= self.low) & (values <= self.high)) | (np.isnan(values) & self.nullable)
        return Table(
            cells=cells,
            numbers=dict(zip(self.kinds, values, strict=True)),
            good=np.logical_and.reduce(within),
        )

    def _values(self, columns: Sequence[Sequence[Any]]) -> F64:
        """Return (K, B) numbers: at once where each is of a type that it may have, else one by one."""
        found = [set(map(type, column)) for column in columns]
        if all(map(frozenset.issuperset, self.kinds.values(), found)):
            present = [i for i, types in enumerate(found) if types != {_ABSENT}]
            values = np.full((len(columns), len(columns[0])), np.nan)
            if not present:
                return values
            try:
                values[present] = np.array([columns[i] for i in present], dtype=np.float64)
            except OverflowError:
                pass
            else:
                nulls = sum(
                    column.count(None) for column, types in zip(columns, found, strict=True) if _ABSENT in types
                )
                if np.count_nonzero(np.isnan(values)) == nulls:
                    return values
        return np.array(
            [
                [_number(value, kinds) for value in column]
                for column, kinds in zip(columns, self.kinds.values(), strict=True)
            ]
        )


def _number(value: Any, kinds: frozenset[type]) -> float:
    """Return NaN for null, and infinity, which no limit allows, for what the model does not accept as a number."""
    if value is None:
        return math.nan
    if type(value) not in kinds:
        return math.inf
    try:
        number = float(value)
    except OverflowError:
        return math.inf
    return math.inf if math.isnan(number) else number
