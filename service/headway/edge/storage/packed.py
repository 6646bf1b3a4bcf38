"""Tables as they are in memory, without the words that are zero."""

from io import BytesIO
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

_WORD: Final = np.uint64
"""A zero word is a bit: it saves a third of a vehicle with a leader, and more of one without."""


def packed(table: NDArray[Any]) -> tuple[memoryview, memoryview]:
    """Return which words of a table are not zero, and these."""
    words = table.view(np.uint8).view(_WORD)
    is_used = words != 0
    return np.packbits(is_used).data, words[is_used].view(np.uint8).data


def unpacked(file: BytesIO, rows: int, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return the next table of a file, of so many rows."""
    words = np.zeros(rows * dtype.itemsize // _WORD().itemsize, _WORD)
    bits = np.frombuffer(file.read(-(-words.size // 8)), np.uint8)
    is_used = np.unpackbits(bits, count=words.size).astype(np.bool_)
    words[is_used] = np.frombuffer(file.read(words.itemsize * int(is_used.sum())), _WORD)
    return words.view(dtype)
