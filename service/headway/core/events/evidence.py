"""The evidence of each row: its last readings, and its state before one of them.

The bank row is copied before it steps, as a checkpoint. The checkpoint and the readings since replay each verdict, bit
for bit, through the same kernel. A checkpoint and the readings after it are a segment. A row has a second segment only
while the newer one has few readings.

A segment is a list of blocks, which all rows share. So memory is only for readings that a replay needs. Words of a
checkpoint that are zero are left out: for each GROUP words there is a word that tells which are not zero, then these.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from headway.core.types.batch import I64
from headway.core.types.records import COMPACT_READING, CONTRADICTIONS_MAX, READING, Records
from headway.core.types.step_result import Evidence

Words = NDArray[np.uint64]
SLOT_WORDS, SLOTS = COMPACT_READING.itemsize // 8, 4
"""Words of a reading, and the readings of a block."""
BLOCK_WORDS = SLOTS * SLOT_WORDS
GROUP = 64
"""Words of a checkpoint, as many as a word has bits."""
NEWEST, EARLIER = 0, 1
"""The two segments of a row."""

SEGMENTS = np.dtype(
    [
        ("count", "i8"),  # readings so far
        ("due", "i8"),  # the count at which the next segment begins
        ("taken", "i8", (2,)),  # the counts at which the segments began
        ("blocks", "i4", (2,)),  # of each segment; 0: no segment
        ("last", "i4"),  # last block of the newest segment,
        ("used", "i4"),  # and the slots used of it
    ],
    align=True,
)


class EvidenceTables(NamedTuple):
    """The segments of C rows in B blocks."""

    segments: Records
    """(C,) SEGMENTS."""
    size: int
    """Most readings of both segments of a row."""
    states: Words
    """(C, words) the bank."""
    blocks: Words
    """(B, BLOCK_WORDS); used from the first on, so that memory that is never needed is never touched."""
    places: NDArray[np.int32]
    """(C, 2, P) the blocks of each segment."""
    free: NDArray[np.int32]
    """(B,) a stack of blocks that were given back,"""
    free_count: I64
    """(2,) its height, and how many blocks were ever used."""
    slots: Records
    """(B SLOTS,) COMPACT_READING: the same memory as `blocks`."""
    packed: Words
    """Room for a checkpoint on its way, and one word more."""


@njit(cache=True, error_model="numpy")
def store_readings(tables: EvidenceTables, rows: I64, readings: Records, leaders: I64) -> None:
    """Store the `readings` and `leaders` (n,) of `rows` (n,); call it before the rows step."""
    fewest = tables.size // 4
    between = tables.size - fewest
    for i in range(rows.size):
        row, of = rows[i], tables.segments[rows[i]]
        if of.count == 0:
            _release(tables, row, NEWEST)
            _begin(tables, row)
            # By its time, because rows that take their checkpoints together would need memory together.
            of.due = fewest + int(1000.0 * readings[i].t_s) % between
        elif of.count == of.due:
            _begin(tables, row)
            of.due += between
        elif of.count == of.taken[NEWEST] + fewest:
            _release(tables, row, EARLIER)
        if of.used == SLOTS:
            _append_blocks(tables.places, tables.free, tables.free_count, row, of.blocks[NEWEST], 1)
            of.last, of.used = tables.places[row, NEWEST, of.blocks[NEWEST]], 0
            of.blocks[NEWEST] += 1
        _compact(readings[i], leaders[i], tables.slots[SLOTS * of.last + of.used])
        of.used += 1
        of.count += 1


@njit(cache=True, error_model="numpy")
def _begin(tables: EvidenceTables, row: int) -> None:
    """Begin a segment with the bank row; the newest one becomes the earlier one."""
    _release(tables, row, EARLIER)
    of = tables.segments[row]
    for k in range(of.blocks[NEWEST]):
        tables.places[row, EARLIER, k] = tables.places[row, NEWEST, k]
    of.blocks[EARLIER], of.taken[EARLIER], of.taken[NEWEST] = of.blocks[NEWEST], of.taken[NEWEST], of.count
    words = _pack(tables.states, row, tables.packed)
    count = (words - 1) // BLOCK_WORDS + 1
    _append_blocks(tables.places, tables.free, tables.free_count, row, 0, count)
    for n in range(count):
        block, start = tables.places[row, NEWEST, n], n * BLOCK_WORDS
        for k in range(min(BLOCK_WORDS, words - start)):
            tables.blocks[block, k] = tables.packed[start + k]
    of.blocks[NEWEST], of.last = count, tables.places[row, NEWEST, count - 1]
    of.used = (words - 1) // SLOT_WORDS + 1 - SLOTS * (count - 1)


@njit(cache=True, error_model="numpy")
def _pack(states: Words, row: int, packed: Words) -> int:
    """Write the words that are not zero, of each group after the word that tells which; return how many it wrote."""
    words = 0
    for start in range(0, states.shape[1], GROUP):
        group, is_used = words, np.uint64(0)
        words += 1
        for k in range(start, min(start + GROUP, states.shape[1])):
            # Written in any case and overwritten after a zero: a branch would be mispredicted half of the time.
            packed[words] = states[row, k]
            kept = np.uint64(states[row, k] != 0)
            is_used |= kept << np.uint64(k - start)
            words += int(kept)
        packed[group] = is_used
    return words


@njit(cache=True, error_model="numpy")
def _append_blocks(places: Any, free: Any, free_count: I64, row: int, after: int, count: int) -> None:
    """Append `count` blocks to those of the newest segment of a row, which has `after` so far.

    Arrays and not their tuple, because numba counts references to each array of a tuple in each call.
    """
    for n in range(after, after + count):
        if free_count[0] > 0:
            free_count[0] -= 1
            places[row, NEWEST, n] = free[free_count[0]]
        else:
            places[row, NEWEST, n] = free_count[1]
            free_count[1] += 1


@njit(cache=True, error_model="numpy")
def _release(tables: EvidenceTables, row: int, which: int) -> None:
    """Give the blocks of a segment back."""
    of, count = tables.segments[row], tables.free_count
    for k in range(of.blocks[which]):
        tables.free[count[0]] = tables.places[row, which, k]
        count[0] += 1
    of.blocks[which] = 0


@njit(cache=True, error_model="numpy")
def _compact(z: Any, leader: int, kept: Any) -> None:
    """Copy a READING and the row of its leader to a COMPACT_READING."""
    kept.t_s, kept.x_m, kept.odometer_std_m, kept.v_mps = z.t_s, z.x_m, z.odometer_std_m, z.v_mps
    kept.leader_t_s, kept.leader_x_m, kept.leader_v_mps = z.leader_t_s, z.leader_x_m, z.leader_v_mps
    kept.leader_length_m, kept.range_m, kept.range_rate_mps = z.leader_length_m, z.range_m, z.range_rate_mps
    kept.east_m, kept.north_m, kept.heading_deg, kept.accuracy_m = z.east_m, z.north_m, z.heading_deg, z.accuracy_m
    kept.overlapped, kept.appeared = z.overlapped > 0.0, z.appeared > 0.0
    kept.contradictions = int(min(max(0.0, z.contradictions), CONTRADICTIONS_MAX))
    kept.leader = leader


@njit(cache=True, error_model="numpy")
def _unpack(packed: Words, state: Words) -> int:
    """Write the `state` that `_pack` packed, and return of how many words."""
    words = 0
    for start in range(0, state.size, GROUP):
        is_used = packed[words]
        words += 1
        for k in range(start, min(start + GROUP, state.size)):
            state[k] = 0
            if is_used >> np.uint64(k - start) & np.uint64(1):
                state[k] = packed[words]
                words += 1
    return words


class EvidenceStore:
    """Readings and checkpoints of the rows of a bank.

    Parameters
    ----------
    bank
        (C,) the rows, of whole words.
    readings
        Most readings R of one evidence, a multiple of 4. There are at least R / 4 and the newest one, if the row has
        so many.
    """

    def __init__(self, bank: Records, readings: int) -> None:
        if readings < 4 or readings % 4:
            raise ValueError(f"evidence needs a number of readings that is a multiple of 4: got {readings}")
        self._dtype = bank.dtype
        states = bank.view(np.uint8).reshape(bank.size, -1).view(np.uint64)
        checkpoint_words = states.shape[1] + -(-states.shape[1] // GROUP)
        checkpoint_blocks = -(-checkpoint_words // BLOCK_WORDS)
        # The readings of a segment begin and end within a block.
        segment_blocks, blocks = checkpoint_blocks + readings // 4 + 1, 2 * checkpoint_blocks + readings // 4 + 2
        words = np.zeros((bank.size * blocks, BLOCK_WORDS), np.uint64)
        self.tables = EvidenceTables(
            segments=np.zeros(bank.size, SEGMENTS),
            size=readings,
            states=states,
            blocks=words,
            places=np.zeros((bank.size, 2, segment_blocks), np.int32),
            free=np.zeros(bank.size * blocks, np.int32),
            free_count=np.zeros(2, np.int64),
            slots=words.reshape(-1).view(COMPACT_READING),
            packed=np.zeros(checkpoint_words + 1, np.uint64),
        )

    def of(self, row: int) -> Evidence:
        """Return the evidence that replays the newest verdict of a row."""
        of, tables = self.tables.segments[row], self.tables
        kept, checkpoint = list[Records](), np.zeros(1, self._dtype)
        for which in (NEWEST, EARLIER):
            count = int(of["blocks"][which])
            if count:
                words = tables.blocks[tables.places[row, which, :count]].reshape(-1)
                slots = -(-_unpack(words, checkpoint.view(np.uint64)) // SLOT_WORDS)
                taken = int((of["count"] if which == NEWEST else of["taken"][NEWEST]) - of["taken"][which])
                kept.insert(0, words.view(COMPACT_READING)[slots : slots + taken])
        compact = np.concatenate([np.empty(0, COMPACT_READING), *kept])
        readings = np.empty(compact.size, READING)
        for name in READING.names or ():
            readings[name] = compact[name]
        return Evidence(checkpoint=checkpoint[0], readings=readings, leaders=compact["leader"].astype(np.int64))

    def newest(self, row: int) -> np.void:
        """Return the newest reading of a row that has one."""
        of = self.tables.segments[row]
        newest: np.void = self.tables.slots[SLOTS * of["last"] + of["used"] - 1]
        return newest

    def clear(self, rows: I64) -> None:
        """Clear the evidence of `rows`; call it after any change of their bank rows except by readings."""
        self.tables.segments["count"][rows] = 0
