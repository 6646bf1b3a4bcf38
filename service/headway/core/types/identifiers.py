"""Identifiers as a column of numbers, compared without a Python object for each."""

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from headway.core.types.batch import Ids

ID_BYTES = 64
"""Length of the longest identifier."""

ID = np.dtype(f"S{ID_BYTES}")


ID_WORDS = ID_BYTES // 8


WORD_BITS = 64


Words = NDArray[np.uint64]
"""(B, 8) the bytes of identifiers, eight in each word, padded with NUL; all NUL for none."""


def id_column(ids: Sequence[str | None]) -> Ids:
    """Return (B,) identifiers, ASCII, as a column; empty for None."""
    return np.array([name or "" for name in ids], ID)


def id_words(column: Ids) -> Words:
    """Return a view (B, 8) of a column of identifiers."""
    return column.view(np.uint64).reshape(-1, ID_WORDS)


@njit(cache=True, error_model="numpy")
def same(one: Words, i: int, other: Words, j: int) -> bool:
    """Whether identifier `i` of `one` (A, 8) equals identifier `j` of `other` (B, 8)."""
    for k in range(ID_WORDS):
        if one[i, k] != other[j, k]:
            return False
        if one[i, k] == 0:
            break
    return True
