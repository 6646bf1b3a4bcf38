"""Identifiers as a column of numbers: compared without an object for any of them."""

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from headway.core.types.batch import Ids

ID_BYTES = 64
"""The longest identifier."""


ID_WORDS = ID_BYTES // 8


WORD_BITS = 64


Words = NDArray[np.uint64]
"""(B, 8) the bytes of names, eight at a time; NUL after the end, and all of it where there is no name."""


def id_column(ids: Sequence[str | None]) -> Ids:
    """Return (B,) identifiers, ASCII, as a column; empty for None."""
    return np.array([name or "" for name in ids], f"S{ID_BYTES}")


def id_words(column: Ids) -> Words:
    """Return a view of names."""
    return column.view(np.uint64).reshape(-1, ID_WORDS)


@njit(cache=True)
def same(one: Words, i: int, other: Words, j: int) -> bool:
    """Whether name `i` of the one (A, 8) equals name `j` of the other (B, 8)."""
    for k in range(ID_WORDS):
        if one[i, k] != other[j, k]:
            return False
        if one[i, k] == 0:
            break
    return True
