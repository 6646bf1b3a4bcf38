"""Identifiers as a column of numbers, and which row each has: looked up without an object for any of them."""

from typing import NamedTuple

import numpy as np
from numba import njit

from headway.core.runtime.prefetch import prefetch_row
from headway.core.types.batch import I64
from headway.core.types.identifiers import _WORD_BITS, _WORDS, NAME_BYTES, Words, same

_NO_ROW = -1
_AHEAD = 8
"""So many names before it is compared a name is asked for."""


class Directory(NamedTuple):
    """A hash table of C rows by name: rows of one bucket are a chain."""

    name: Words
    """(C, 8) of each row; zeros for none."""
    following: I64
    """(C,) the next row of the chain, -1 after the last."""
    first: I64
    """(buckets,) the first row of each chain, -1 for none."""
    factors: Words
    """Secret, so that nobody can choose identifiers that fall together; no result depends on them."""


def new_directory(capacity: int) -> Directory:
    """Return a table with room for `capacity` names."""
    buckets = 1 << max(1, (2 * capacity - 1).bit_length())
    return Directory(
        np.zeros((capacity, _WORDS), np.uint64),
        np.full(capacity, _NO_ROW),
        np.full(buckets, _NO_ROW),
        np.random.default_rng().integers(0, 1 << _WORD_BITS, 2 * _WORDS + 1, np.uint64),
    )


@njit(cache=True)
def find(directory: Directory, wanted: Words, out_rows: I64) -> None:
    """Write the row of each of the `wanted` (B, 8); -1 where there is none."""
    for i in range(out_rows.size):
        out_rows[i] = _NO_ROW
        if wanted[i, 0] != 0:
            out_rows[i] = directory.first[_bucket(directory, wanted, i)]
    for i in range(out_rows.size):
        if i + _AHEAD < out_rows.size and out_rows[i + _AHEAD] != _NO_ROW:
            prefetch_row(directory.name, out_rows[i + _AHEAD], 0, NAME_BYTES)
        while out_rows[i] != _NO_ROW and not same(directory.name, out_rows[i], wanted, i):
            out_rows[i] = directory.following[out_rows[i]]


@njit(cache=True)
def enrol(directory: Directory, row: int, wanted: Words, i: int) -> None:
    """Give a free row to name `i` of the `wanted` (B, 8), which has none."""
    bucket = _bucket(directory, wanted, i)
    directory.name[row] = wanted[i]
    directory.following[row] = directory.first[bucket]
    directory.first[bucket] = row


@njit(cache=True)
def strike(directory: Directory, row: int) -> None:
    """Take the name of a row out."""
    bucket = _bucket(directory, directory.name, row)
    if directory.first[bucket] == row:
        directory.first[bucket] = directory.following[row]
    else:
        before = directory.first[bucket]
        while directory.following[before] != row:
            before = directory.following[before]
        directory.following[before] = directory.following[row]
    directory.name[row] = 0


@njit(cache=True)
def _bucket(directory: Directory, of: Words, i: int) -> int:
    """Hash name `i` of (B, 8): the upper bits of a sum of products of its halves of words, which is universal.

    M. Dietzfelbinger, "Universal hashing and k-wise independent random variables via integer arithmetic without
    primes", STACS 1996.
    """
    factors = directory.factors
    total = factors[0]
    for k in range(_WORDS):
        word = of[i, k]
        if word == 0:
            break
        total += factors[2 * k + 1] * (word & np.uint64(0xFFFF_FFFF))
        total += factors[2 * k + 2] * (word >> np.uint64(32))
    return int((total >> np.uint64(32)) & np.uint64(directory.first.size - 1))
