"""The row of each identifier: a hash table that compares identifiers without a Python object for each."""

from typing import NamedTuple

import numpy as np
from numba import njit

from headway.core.runtime.prefetch import prefetch_row
from headway.core.types.batch import I64
from headway.core.types.identifiers import ID_BYTES, ID_WORDS, WORD_BITS, Words, same

_NO_ROW = -1
_AHEAD = 8
"""Distance of the prefetch, in identifiers."""


class IdIndex(NamedTuple):
    """A hash table of C rows by identifier; the rows of one bucket form a chain."""

    name: Words
    """(C, 8) the identifier of each row; zeros for a free row."""
    next_row: I64
    """(C,) the next row of the chain, -1 after the last."""
    first_row: I64
    """(buckets,) the first row of each chain, -1 for none."""
    factors: Words
    """Random, so that a sender cannot choose identifiers of one bucket; no result depends on them."""


def new_id_index(capacity: int) -> IdIndex:
    """Return an empty index of `capacity` rows."""
    buckets = 1 << max(1, (2 * capacity - 1).bit_length())
    return IdIndex(
        np.zeros((capacity, ID_WORDS), np.uint64),
        np.full(capacity, _NO_ROW),
        np.full(buckets, _NO_ROW),
        np.random.default_rng().integers(0, 1 << WORD_BITS, 2 * ID_WORDS + 1, np.uint64),
    )


@njit(cache=True, error_model="numpy")
def find(index: IdIndex, ids: Words, out_rows: I64) -> None:
    """Write the row of each of the `ids` (B, 8); -1 where there is none."""
    for i in range(out_rows.size):
        out_rows[i] = _NO_ROW
        if ids[i, 0] != 0:
            out_rows[i] = index.first_row[_bucket(index, ids, i)]
    for i in range(out_rows.size):
        if i + _AHEAD < out_rows.size and out_rows[i + _AHEAD] != _NO_ROW:
            prefetch_row(index.name, out_rows[i + _AHEAD], 0, ID_BYTES)
        while out_rows[i] != _NO_ROW and not same(index.name, out_rows[i], ids, i):
            out_rows[i] = index.next_row[out_rows[i]]


@njit(cache=True, error_model="numpy")
def insert(index: IdIndex, row: int, ids: Words, i: int) -> None:
    """Assign a free row to identifier `i` of the `ids` (B, 8), which has none."""
    bucket = _bucket(index, ids, i)
    index.name[row] = ids[i]
    index.next_row[row] = index.first_row[bucket]
    index.first_row[bucket] = row


@njit(cache=True, error_model="numpy")
def remove(index: IdIndex, row: int) -> None:
    """Remove the identifier of a row."""
    bucket = _bucket(index, index.name, row)
    if index.first_row[bucket] == row:
        index.first_row[bucket] = index.next_row[row]
    else:
        before = index.first_row[bucket]
        while index.next_row[before] != row:
            before = index.next_row[before]
        index.next_row[before] = index.next_row[row]
    index.name[row] = 0


@njit(cache=True, error_model="numpy")
def _bucket(index: IdIndex, of: Words, i: int) -> int:
    """Hash identifier `i` of (B, 8): the upper bits of a sum of products of half words, which is universal.

    M. Dietzfelbinger, "Universal hashing and k-wise independent random variables via integer arithmetic without
    primes", STACS 1996.
    """
    factors = index.factors
    total = factors[0]
    for k in range(ID_WORDS):
        word = of[i, k]
        if word == 0:
            break
        total += factors[2 * k + 1] * (word & np.uint64(0xFFFF_FFFF))
        total += factors[2 * k + 2] * (word >> np.uint64(32))
    return int((total >> np.uint64(32)) & np.uint64(index.first_row.size - 1))
