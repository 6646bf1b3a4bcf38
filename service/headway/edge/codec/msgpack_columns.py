"""Compact msgpack records to columns: one compiled pass over the payloads of a batch.

It reads arrays of numbers and a short string, alone or in bundles, which nearly all senders send. A payload with
anything else, or with a number out of its limits, is left to msgpack and the model, which name the reason.
"""

from typing import Any, Final, NamedTuple

import numpy as np
from numba import njit

from headway.core.types.batch import F64, I64, Ids
from headway.core.types.identifiers import ID_BYTES, Words, id_words, same
from headway.edge.codec.layout import Layout
from headway_schemas.bsm import Bsm, Leader
from headway_schemas.keys import is_id

_BSM, _LEADER = Layout.of(Bsm), Layout.of(Leader)
NAMES: Final = (*_BSM.kinds, *_LEADER.kinds)
"""Names of the K numbers of a record; those of its leader come last."""
ID, LEADER = _BSM.fields.index("id"), _BSM.fields.index("leader")
"""Places in a record of the fields that are no numbers."""
FIELDS, LEADER_FIELDS, OF_LEADER = len(_BSM.fields), len(_LEADER.fields), len(_BSM.kinds)
IN_AN_ID: Final = np.array([is_id(chr(byte)) for byte in range(256)])
"""(256,) whether a byte may be in an identifier."""

WORD = np.dtype(
    {"names": ["u8", "i8", "f8", "f4"], "formats": ["u8", "i8", "f8", "f4"], "offsets": [0] * 4, "itemsize": 8}
)
"""Eight bytes as one of these types. A record, because a view of an array is a counted reference."""
FIX_ARRAY, FIX_STRING, NIL, FLOAT_32, FLOAT_64 = 0x90, 0xA0, 0xC0, 0xCA, 0xCB
UINT_8, INT_8, INT_64, STRING_8, ARRAY_16 = 0xCC, 0xD0, 0xD3, 0xD9, 0xDC
"""First bytes of msgpack."""


LIMIT = np.dtype([("low", "f8"), ("high", "f8"), ("nullable", "?"), ("integer", "?")])
LIMITS: Final = np.zeros(len(NAMES), LIMIT)
"""(K,) limits of each number."""
for _layout, _part in ((_BSM, slice(OF_LEADER)), (_LEADER, slice(OF_LEADER, None))):
    LIMITS["low"][_part], LIMITS["high"][_part] = _layout.low.ravel(), _layout.high.ravel()
    LIMITS["nullable"][_part] = _layout.nullable.ravel()
    LIMITS["integer"][_part] = [float not in kinds for kinds in _layout.kinds.values()]


class CompactRecords(NamedTuple):
    """B records as columns."""

    numbers: F64
    """(K, B) by `NAMES`, NaN where null."""
    ids: Ids
    """(B,)"""
    leader_ids: Ids
    """(B,) empty where none is declared."""
    sizes: I64
    """(P,) records of each payload."""


def read(payloads: bytes, sizes: I64, owners: bytes, bundle_max: int) -> CompactRecords | None:
    """Read payloads that lie end to end, of `sizes` (P,) bytes; None if one of them is of another form.

    `owners` are P ids end to end, of ID_BYTES each: the only sender allowed in each payload; all NUL: any sender.
    """
    most = len(payloads) // OF_LEADER + 1  # a record that is complete is longer
    numbers, records = np.empty((len(NAMES), most)), np.empty_like(sizes)
    ids, leader_ids = np.empty(most, f"S{ID_BYTES}"), np.empty(most, f"S{ID_BYTES}")
    buffer = np.frombuffer(payloads, np.uint8)
    owned = id_words(np.frombuffer(owners, f"S{ID_BYTES}"))
    count = _read(buffer, sizes, owned, bundle_max, LIMITS, numbers, id_words(ids), id_words(leader_ids), records)
    if count < 0:
        return None
    return CompactRecords(numbers[:, :count], ids[:count], leader_ids[:count], records)


_inlined: Final = njit(cache=True, error_model="numpy", inline="always")
"""A call costs as much as reading a number."""


@njit(cache=True, error_model="numpy")
def _read(
    buffer: Any,
    sizes: I64,
    owners: Words,
    bundle_max: int,
    limits: Any,
    numbers: F64,
    ids: Words,
    leader_ids: Words,
    out_records: I64,
) -> int:
    """Fill in the columns and return how many records there are, -1 if a payload is of another form."""
    workspace = np.zeros(1, WORD)  # used to the end, because a record does not keep its array alive
    count, at, end = 0, 0, 0
    for payload in range(sizes.size):
        end += sizes[payload]
        records = 1
        size, first = _array(buffer, at, end)
        if _array(buffer, first, end)[0] >= 0:
            records, at = size, first
        if not 1 <= records <= bundle_max:
            return -1
        for _ in range(records):
            if count == ids.shape[0]:
                return -1
            at = _record(buffer, at, end, limits, workspace[0], count, numbers, ids, leader_ids)
            if at < 0 or same(ids, count, leader_ids, count):
                return -1
            if owners[payload, 0] != 0 and not same(ids, count, owners, payload):
                return -1
            count += 1
        if at != end:
            return -1
        out_records[payload] = records
    return count


@_inlined
def _record(
    buffer: Any, at: int, end: int, limits: Any, word: Any, i: int, numbers: F64, ids: Words, leader_ids: Words
) -> int:
    """Read record `i` and return where it ends, -1 if it is of another form."""
    fields, at = _array(buffer, at, end)
    if not ID < fields <= FIELDS:
        return -1
    leader_ids[i] = 0
    k = 0
    for field in range(FIELDS):
        if field == ID:
            at = _identifier(buffer, at, end, i, ids)
        elif field != LEADER:
            at = _number(buffer, at, end if field < fields else at, limits, word, k, i, numbers)
            k += 1
        elif field < fields and at < end and buffer[at] != NIL:
            at = _leader(buffer, at, end, limits, word, i, numbers, leader_ids)
        else:
            at += field < fields
            for absent in range(OF_LEADER, numbers.shape[0]):
                numbers[absent, i] = np.nan
        if at < 0:
            return -1
    return at if at <= end else -1


@_inlined
def _leader(buffer: Any, at: int, end: int, limits: Any, word: Any, i: int, numbers: F64, leader_ids: Words) -> int:
    """Read the leader of record `i` and return where it ends, -1 if it is of another form."""
    fields, at = _array(buffer, at, end)
    if not 1 <= fields <= LEADER_FIELDS:
        return -1
    at = _identifier(buffer, at, end, i, leader_ids)
    for k in range(1, LEADER_FIELDS):
        if at >= 0:
            at = _number(buffer, at, end if k < fields else at, limits, word, OF_LEADER + k - 1, i, numbers)
    return at


@_inlined
def _array(buffer: Any, at: int, end: int) -> tuple[int, int]:
    """Return (size, where the first item begins) of an array, (-1, at) where there is none."""
    if at < end and buffer[at] & 0xF0 == FIX_ARRAY:
        return buffer[at] & 0x0F, at + 1
    if at + 2 < end and buffer[at] == ARRAY_16:
        return buffer[at + 1] << 8 | buffer[at + 2], at + 3
    return -1, at


@_inlined
def _identifier(buffer: Any, at: int, end: int, i: int, out_ids: Words) -> int:
    """Copy an identifier to row `i` and return where it ends, -1 where there is none."""
    if at + 1 >= end:
        return -1
    size, start = int(buffer[at] & 0x1F), at + 1
    if buffer[at] == STRING_8:
        size, start = int(buffer[at + 1]), at + 2
    elif buffer[at] & 0xE0 != FIX_STRING:
        return -1
    if not 0 < size <= ID_BYTES or start + size > end:
        return -1
    out_ids[i] = 0
    for k in range(size):
        byte = buffer[start + k]
        if not IN_AN_ID[byte]:
            return -1
        out_ids[i, k >> 3] |= np.uint64(byte) << np.uint64(8 * (k & 7))
    return start + size


@_inlined
def _number(buffer: Any, at: int, end: int, limits: Any, word: Any, k: int, i: int, out_numbers: F64) -> int:
    """Read number `k` of record `i`, nothing at all where `at` is `end`, and return where it ends.

    -1 where it is none, or not within its limits.
    """
    limit = limits[k]
    first = buffer[at] if at < end else np.uint8(NIL)
    if first == NIL:
        out_numbers[k, i] = np.nan
        return min(at + 1, end) if limit.nullable else -1
    after = at + 1
    if first < 0x80:
        value = float(first)
    elif first >= 0xE0:
        value = float(first) - 256.0
    elif not FLOAT_32 <= first <= INT_64 or (first < UINT_8 and limit.integer):
        return -1
    else:
        size = int(1 << (first & 3) if first >= UINT_8 else 4 << (first & 1))
        after += size
        if after > end:
            return -1
        bits = np.uint64(0)
        for byte in range(at + 1, after):
            bits = bits << np.uint64(8) | np.uint64(buffer[byte])
        word.u8 = bits
        if first == FLOAT_64:
            value = word.f8
        elif first == FLOAT_32:
            value = float(word.f4)
        elif first < INT_8:
            value = float(bits)
        else:
            word.u8 = bits << np.uint64(64 - 8 * size)
            value = float(word.i8 >> np.int64(64 - 8 * size))
    out_numbers[k, i] = value
    return after if limit.low <= value <= limit.high else -1
