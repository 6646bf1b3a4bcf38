"""Mutations of bytes, as fuzzers make them."""

from collections.abc import Sequence

import numpy as np

_INTERESTING = [0x00, 0x01, 0x7F, 0x80, 0x90, 0xC0, 0xC1, 0xCB, 0xCF, 0xDC, 0xDD, 0xDF, 0xFF, *b'"{}[],:-.0eE9\\n']


class Mutator:
    """Makes variants of seeds; the same generator makes the same ones."""

    def __init__(self, seeds: Sequence[bytes], rng: np.random.Generator) -> None:
        self._seeds = seeds
        self._rng = rng

    def next(self) -> bytes:
        """Return a seed with up to four mutations; one in eight is the seed itself."""
        data = bytearray(self._pick())
        for _ in range(int(self._rng.integers(5)) if self._rng.random() > 0.125 else 0):
            self._mutate(data)
        return bytes(data)

    def _pick(self) -> bytes:
        return self._seeds[int(self._rng.integers(len(self._seeds)))]

    def _mutate(self, data: bytearray) -> None:
        rng = self._rng
        at, length = int(rng.integers(len(data) + 1)), int(rng.integers(1, 9))
        match int(rng.integers(7)):
            case 0 if at < len(data):
                data[at] ^= 1 << int(rng.integers(8))
            case 1 if at < len(data):
                data[at] = _INTERESTING[int(rng.integers(len(_INTERESTING)))]
            case 2:
                data[at:at] = rng.bytes(length)
            case 3:
                del data[at : at + length]
            case 4:
                data[at:at] = data[at : at + length] * int(rng.integers(1, 20))
            case 5:
                other = self._pick()
                data[at:] = other[int(rng.integers(len(other) + 1)) :]
            case _:
                data[at : at + length] = rng.bytes(length)
