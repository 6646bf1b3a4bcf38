"""The row of each vehicle, up to a capacity; rows of evicted vehicles are used again."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from headway.core.tracking.id_index import find, insert, new_id_index, remove
from headway.core.types.batch import I64, Ids
from headway.core.types.identifiers import id_column, id_words


class VehicleTable:
    """Identifiers to rows and back; `generation` (C,) changes whenever a row gets another vehicle."""

    def __init__(self, capacity: int) -> None:
        self.id_index = new_id_index(capacity)
        self.id_of: list[str | None] = [None] * capacity
        self.generation: I64 = np.zeros(capacity, np.int64)
        self.in_use: NDArray[np.bool_] = np.zeros(capacity, np.bool_)
        self._free = list(range(capacity - 1, -1, -1))
        self._generation = 0

    def __len__(self) -> int:
        """Return how many vehicles are known."""
        return len(self.id_of) - len(self._free)

    def rows(self, ids: Ids) -> I64:
        """Return (B,) the row of each id; -1 where it has none, and where there is no id."""
        rows = np.empty(ids.size, np.int64)
        find(self.id_index, id_words(ids), rows)
        return rows

    def row(self, vehicle: str) -> int | None:
        """Return the row of one id; None where it has none."""
        row = int(self.rows(id_column([vehicle]))[0])
        return None if row < 0 else row

    def admit(self, ids: Iterable[str]) -> list[int]:
        """Assign a row to each new id, in this order, and return the rows; a full table leaves the last ids without."""
        assigned = []
        for vehicle in ids:
            if not self._free:
                break
            row = self._free.pop()
            self._assign(row, vehicle)
            assigned.append(row)
        return assigned

    def restore(self, rows: I64, ids: list[str]) -> None:
        """Assign these free `rows` (n,) to these new `ids`."""
        taken = dict(zip(rows.tolist(), ids, strict=True))
        self._free = [row for row in self._free if row not in taken]
        for row, vehicle in taken.items():
            self._assign(row, vehicle)

    def evict(self, row: int) -> None:
        """Free a row."""
        vehicle = self.id_of[row]
        if vehicle is None:
            raise ValueError(f"row {row} is not in use")
        remove(self.id_index, row)
        self.id_of[row] = None
        self.in_use[row] = False
        self.generation[row] = 0
        self._free.append(row)

    def _assign(self, row: int, vehicle: str) -> None:
        self._generation += 1
        insert(self.id_index, row, id_words(id_column([vehicle])), 0)
        self.id_of[row] = vehicle
        self.generation[row] = self._generation
        self.in_use[row] = True
