"""Calls of compiled functions that leave out what numba does before each: to look at the types of all arguments."""

from collections.abc import Callable
from typing import Any

import numba


def bind_signature(kernel: Any) -> Callable[..., Any]:
    """Return `kernel` for arguments that have, at every call, the types and memory layouts that they have at the first.

    That is not checked again, and arrays of others would be misread: it is for tables, and for columns that were made
    contiguous. Where tuples of many arrays and numbers are passed it saves more than a reading costs.
    """
    compiled: Callable[..., Any] | None = None

    def call(*arguments: Any) -> Any:
        nonlocal compiled
        if compiled is None:
            compiled = kernel.compile(tuple(map(numba.typeof, arguments)))
        return compiled(*arguments)

    return call
