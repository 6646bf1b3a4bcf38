"""Memory asked for before it is needed: the rows of a wave lie anywhere in a table that no cache holds."""

from typing import Any

from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

LINE_BYTES = 64


def _ask_for(_typing: Any, _address: Any) -> Any:
    """Type and code of `_prefetch(address)`: LLVM's own instruction, of which numba knows nothing."""

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        byte, number = ir.IntType(8).as_pointer(), ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [byte, number, number, number])
        instruction = builder.module.declare_intrinsic("llvm.prefetch", [byte], kind)
        to_write, to_keep, as_data = number(1), number(3), number(1)
        builder.call(instruction, [builder.inttoptr(arguments[0], byte), to_write, to_keep, as_data])
        return context.get_dummy_value()

    return types.void(types.uintp), generate


_prefetch: Any = intrinsic(_ask_for)


@njit(cache=True, error_model="numpy")
def prefetch_row(table: Any, row: int, start: int, stop: int) -> None:
    """Ask for the bytes from `start` to `stop` of a row of `table` (C,); a hint, which changes no result."""
    address = table.ctypes.data + row * table.strides[0]
    for byte in range(start, stop, LINE_BYTES):
        _prefetch(address + byte)
