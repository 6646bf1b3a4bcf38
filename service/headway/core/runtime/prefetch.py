"""Prefetch of memory: the rows of a round are spread over a table that is larger than the caches."""

from typing import Any

from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

LINE_BYTES = 64
"""Cache line of x86-64 and most ARM processors."""


def _prefetch_intrinsic(_typing: Any, _address: Any) -> Any:
    """Type and code of `_prefetch(address)`: an instruction of LLVM that numba does not offer."""

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        byte, number = ir.IntType(8).as_pointer(), ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [byte, number, number, number])
        instruction = builder.module.declare_intrinsic("llvm.prefetch", [byte], kind)
        to_write, to_keep, as_data = number(1), number(3), number(1)
        builder.call(instruction, [builder.inttoptr(arguments[0], byte), to_write, to_keep, as_data])
        return context.get_dummy_value()

    return types.void(types.uintp), generate


_prefetch: Any = intrinsic(_prefetch_intrinsic)


@njit(cache=True, error_model="numpy")
def prefetch_row(table: Any, row: int, start: int, stop: int) -> None:
    """Prefetch the bytes from `start` to `stop` of a row of `table` (C,); a hint that changes no result."""
    address = table.ctypes.data + row * table.strides[0]
    for byte in range(start, stop, LINE_BYTES):
        _prefetch(address + byte)
