"""The compiled search for frames and the reading of their fields: all kernels of the binary feeds.

Fields of unaligned PER (ITU-T X.691) with fixed widths lie at fixed bits, so a message is a table of places. The kernel
finds where each message begins, behind text, IEEE 1609.3 and 1609.2 headers or anything else, and reads the table.
"""

from typing import Any, Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
I64 = NDArray[np.int64]

READ, NOT_FOUND, OTHER, FRAGMENTED, ENCRYPTED, CUT = 0, 1, 2, 3, 4, 5
"""What came of a frame."""
BSM_ID: Final = 20
FIRST_ID, LAST_ID = 18, 45
"""Message types of J2735 that are recognised behind an unknown header."""
BSM_BYTES, CAM_BYTES = 37, 41
"""Least sizes of a basic safety message and of a cooperative awareness message of a vehicle."""
_UNSECURED, _SIGNED, _ENCRYPTED, _CERTIFICATE_REQUEST = 0x80, 0x81, 0x82, 0x83
_WSM_MAX_DEPTH: Final = 6
_NIBBLE: Final = np.full(256, -1, np.int64)
for _digit in range(16):
    _NIBBLE[ord(f"{_digit:x}")] = _NIBBLE[ord(f"{_digit:X}")] = _digit
_PAYLOAD: Final = np.frombuffer(b"payload=", np.uint8)

_compiled: Final = njit(cache=True, error_model="numpy")


@njit(cache=True, error_model="numpy")
def read_bsm(buffer: Bytes, starts: I64, ends: I64, table: I64, numbers: I64, status: I64, detail: I64) -> None:
    """Read the BSM of each frame into `numbers` (K, B); `buffer` is overwritten where it holds hex digits.

    `table` (K, 3) has the first bit, the width and the least value of each field. `status` and `detail` (B,) say what
    a frame is, and for OTHER the id of its message type.
    """
    for i in range(starts.size):
        end = _binary(buffer, starts[i], ends[i])
        at, found = _frame(buffer, starts[i], end)
        if found == READ:
            message_id, first, last = _message_frame(buffer, at, end)
            if message_id == BSM_ID and last - first < BSM_BYTES:
                found = CUT
            elif message_id != BSM_ID:
                found, detail[i] = OTHER, message_id
            else:
                _fields(buffer, first, table, numbers, i)
        status[i] = found


@njit(cache=True, error_model="numpy")
def read_cam(buffer: Bytes, starts: I64, ends: I64, table: I64, numbers: I64, status: I64, detail: I64) -> None:
    """Read the CAM of each frame as `read_bsm` does; `detail` is the message id of the ITS PDU header."""
    for i in range(starts.size):
        end = _binary(buffer, starts[i], ends[i])
        at = _its_pdu(buffer, starts[i], end)
        if at < 0:
            status[i] = NOT_FOUND
        elif buffer[at + 1] != 2:
            status[i], detail[i] = OTHER, buffer[at + 1]
        elif end - at < CAM_BYTES:
            status[i] = CUT
        elif _bits(buffer, at, 199, 2) != 0:
            status[i], detail[i] = OTHER, 2  # the container of a roadside unit
        else:
            _fields(buffer, at, table, numbers, i)
            status[i] = READ


@_compiled
def _fields(buffer: Bytes, first: int, table: I64, numbers: I64, i: int) -> None:
    for k in range(table.shape[0]):
        numbers[k, i] = _bits(buffer, first, table[k, 0], table[k, 1]) + table[k, 2]


@_compiled
def _bits(buffer: Bytes, first: int, bit: int, width: int) -> int:
    """Return the unsigned integer of `width` bits, 32 at most, from `bit` of the message on."""
    at, last = first + (bit >> 3), first + ((bit + width - 1) >> 3)
    value = 0
    for k in range(at, last + 1):
        value = value << 8 | int(buffer[k])
    return (value >> (7 - ((bit + width - 1) & 7))) & ((1 << width) - 1)


@_compiled
def _binary(buffer: Bytes, start: int, end: int) -> int:
    """Turn text into the octets of its hex digits, in place, and return where they end; `end` if it is no text.

    Behind `Payload=`, as in the text of an RSU's immediate forward message, only what follows it counts.
    """
    for k in range(start, end):
        byte = buffer[k]
        if not (32 <= byte < 127 or 9 <= byte <= 13):
            return end
    at = start
    for k in range(start, end - _PAYLOAD.size + 1):
        same = 0
        while same < _PAYLOAD.size and (buffer[k + same] | (0x20 if same < _PAYLOAD.size - 1 else 0)) == _PAYLOAD[same]:
            same += 1
        if same == _PAYLOAD.size:
            at = k + same
    while at < end and buffer[at] <= 32:
        at += 1
    if at + 1 < end and buffer[at] == 0x30 and buffer[at + 1] | 0x20 == 0x78:
        at += 2
    written, high = start, -1
    while at < end:
        digit = _NIBBLE[buffer[at]]
        at += 1
        if digit < 0:
            if buffer[at - 1] > 32:
                return start
        elif high < 0:
            high = digit
        else:
            buffer[written] = np.uint8(high << 4 | digit)
            written, high = written + 1, -1
    return written if high < 0 else start


@_compiled
def _frame(buffer: Bytes, start: int, end: int) -> tuple[int, int]:
    """Return (where the MessageFrame begins, what came of it)."""
    at, found = _unwrapped(buffer, start, end)
    if found != READ:
        return at, found
    message_id, first, _ = _message_frame(buffer, at, end)
    if message_id >= 0:
        return at, READ
    for k in range(start, end - BSM_BYTES - 2):
        if buffer[k] == 0 and buffer[k + 1] == BSM_ID and _is_plausible(buffer, k, end):
            return k, READ
    for k in range(start, end - 4):
        if buffer[k] == 0 and FIRST_ID <= buffer[k + 1] <= LAST_ID:
            message_id, _, last = _message_frame(buffer, k, end)
            if message_id >= 0 and message_id != BSM_ID and last == end:
                return k, READ
    if first == FRAGMENTED:
        return at, FRAGMENTED
    return at, CUT if end - at >= 4 and buffer[at] == 0 and buffer[at + 1] == BSM_ID else NOT_FOUND


@_compiled
def _message_frame(buffer: Bytes, at: int, end: int) -> tuple[int, int, int]:
    """Return (message id, first byte, end of its value); -1 where there is no frame, then FRAGMENTED or 0."""
    if end - at < 4 or buffer[at] & 0x80:
        return -1, 0, 0
    message_id = int(buffer[at]) << 8 | int(buffer[at + 1])
    size, first = int(buffer[at + 2]), at + 3
    if size >= 0xC0:
        return -1, FRAGMENTED if message_id == BSM_ID else 0, 0
    if size >= 0x80:
        size, first = (size & 0x3F) << 8 | int(buffer[at + 3]), at + 4
    if not FIRST_ID <= message_id <= LAST_ID or size == 0 or first + size > end:
        return -1, 0, 0
    return message_id, first, first + size


@_compiled
def _is_plausible(buffer: Bytes, at: int, end: int) -> bool:
    """Whether a BSM begins here whose size fits its options and whose position can be."""
    message_id, first, last = _message_frame(buffer, at, end)
    if message_id != BSM_ID or last - first < BSM_BYTES:
        return False
    if (last - first > BSM_BYTES) != (buffer[first] & 0xE0 != 0):
        return False
    return _bits(buffer, first, 58, 31) <= 1_800_000_001 and _bits(buffer, first, 89, 32) <= 3_600_000_000


@_compiled
def _unwrapped(buffer: Bytes, start: int, end: int) -> tuple[int, int]:
    """Return (where the payload begins behind 1609.3 and 1609.2 headers, what came of it)."""
    at = start
    for _ in range(_WSM_MAX_DEPTH):
        if end - at < 4 or buffer[at] & 0xF7 != 3:
            break
        content = buffer[at + 1]
        if buffer[at] == 3 and content == _UNSECURED:
            size, at = _length(buffer, at + 2, end)
            if size < 0:
                return at, CUT
        elif buffer[at] == 3 and content == _SIGNED:
            if end - at < 6 or buffer[at + 3] & 0x40 == 0:
                return at, NOT_FOUND
            at += 4
        elif buffer[at] == 3 and content in (_ENCRYPTED, _CERTIFICATE_REQUEST):
            return at, ENCRYPTED
        else:
            behind = _behind_wsmp(buffer, at, end)
            if behind < 0:
                break
            at = behind
    return at, READ


@_compiled
def _behind_wsmp(buffer: Bytes, at: int, end: int) -> int:
    """Return where the data of a WAVE short message begin (IEEE 1609.3, version 3); -1 if it is none."""
    after = at + 1
    if buffer[at] & 8:
        after = _behind_elements(buffer, after, end)
    if after < 0 or after >= end or buffer[after] > 1:
        return -1
    extended = buffer[after] == 1
    after += 1
    if after >= end:
        return -1
    first = buffer[after]  # the leading ones of a PSID are the octets that follow
    after += 1 if first < 0x80 else 2 if first < 0xC0 else 3 if first < 0xE0 else 4
    if extended:
        after = _behind_elements(buffer, after, end)
    if after < 0 or after >= end:
        return -1
    after += 2 if buffer[after] & 0x80 else 1
    return after if after < end else -1


@_compiled
def _behind_elements(buffer: Bytes, at: int, end: int) -> int:
    """Return what lies behind a count and as many information elements; -1 if they do not fit."""
    if at >= end:
        return -1
    count, after = int(buffer[at]), at + 1
    for _ in range(count):
        if after + 1 >= end:
            return -1
        after += 2 + int(buffer[after + 1])
    return after if after < end else -1


@_compiled
def _length(buffer: Bytes, at: int, end: int) -> tuple[int, int]:
    """Return (size, where the content begins) of an octet string of COER; size -1 if it does not fit."""
    if at >= end:
        return -1, at
    size, after = int(buffer[at]), at + 1
    if size >= 0x80:
        octets = size & 0x7F
        if octets > 3 or after + octets > end:
            return -1, at
        size = 0
        for k in range(after, after + octets):
            size = size << 8 | int(buffer[k])
        after += octets
    return (size, after) if after + size <= end else (-1, at)


@_compiled
def _its_pdu(buffer: Bytes, start: int, end: int) -> int:
    """Return where the ITS PDU header begins: at once, or behind the BTP-B header of port 2001; -1 if nowhere."""
    if end - start >= 8 and 1 <= buffer[start] <= 3 and 1 <= buffer[start + 1] <= 20:
        return start
    for k in range(start, end - CAM_BYTES - 3):
        is_port = buffer[k] == 0x07 and buffer[k + 1] == 0xD1
        if is_port and 1 <= buffer[k + 4] <= 3 and buffer[k + 5] == 2:
            return k + 4
    return -1


def as_bytes(frames: Any) -> tuple[Bytes, I64, I64]:
    """Lay frames end to end: a buffer that may be written, (B,) where each begins and ends."""
    ends = np.cumsum(np.fromiter(map(len, frames), np.int64, len(frames)))
    starts = np.concatenate([[0], ends[:-1]]).astype(np.int64)
    return np.frombuffer(bytearray(b"".join(frames)), np.uint8), starts, ends
