"""Calls of compiled functions without numba's look-up of the types of all arguments."""

from collections.abc import Callable
from typing import Any

import numba

check_arguments = False
"""Whether each call of a bound kernel checks its arguments against those of the first call; all tests set it."""


def bind_signature(kernel: Any) -> Callable[..., Any]:
    """Return `kernel` compiled for the types, dimensions and memory layouts of the arguments of the first call.

    Later calls must pass the same, because other arrays would be misread; only `check_arguments` makes them raise
    TypeError. For tuples of many arrays this saves more than the work on one reading.
    """
    compiled: Callable[..., Any] | None = None
    bound: tuple[Any, ...] = ()

    def call(*arguments: Any) -> Any:
        nonlocal compiled, bound
        if compiled is None:
            bound = tuple(map(numba.typeof, arguments))
            compiled = kernel.compile(bound)
        elif check_arguments and (given := tuple(map(numba.typeof, arguments))) != bound:
            raise TypeError(f"{kernel.__name__} is bound to {bound}, called with {given}")
        return compiled(*arguments)

    return call
