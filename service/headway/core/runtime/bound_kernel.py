"""Calls of compiled functions without numba's look-up of the types of all arguments."""

from collections.abc import Callable
from typing import Any

import numba
import numpy as np

check_arguments = False
"""Whether each call of a bound kernel checks its arguments against those of the first call; all tests set it."""


def bind_signature(kernel: Any) -> Callable[..., Any]:
    """Return `kernel` compiled for the types, dimensions and memory layouts of the arguments of the first call.

    Later calls must pass the same, because other arrays would be misread; only `check_arguments` makes them raise
    TypeError. For tuples of many arrays this saves more than the work on one reading.
    """
    compiled: Callable[..., Any] | None = None
    bound: tuple[Any, ...] = ()
    described: Any = ()

    def call(*arguments: Any) -> Any:
        nonlocal compiled, bound, described
        if compiled is None:
            bound, described = tuple(map(numba.typeof, arguments)), _described(arguments)
            compiled = kernel.compile(bound)
        elif check_arguments and _described(arguments) != described:
            given = tuple(map(numba.typeof, arguments))
            raise TypeError(f"{kernel.__name__} is bound to {bound}, called with {given}")
        return compiled(*arguments)

    return call


def _described(argument: Any) -> Any:
    """Return what numba's type of an argument depends on: its own look-up of a record takes milliseconds."""
    if isinstance(argument, np.ndarray):
        flags = argument.flags
        layout = "C" if flags.c_contiguous else "F" if flags.f_contiguous else "A"
        return argument.dtype, argument.ndim, layout, flags.aligned, flags.writeable
    if isinstance(argument, tuple):
        return type(argument), tuple(map(_described, argument))
    return type(argument)
