"""Errors that the user of a command can repair."""

import re
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from pydantic import ValidationError

_SOURCE_PLACE: Final = re.compile(r" at /\S+\.rs:\d+\.?")


class UserError(Exception):
    """One line: what is wrong and what to do. A command that raises it ends with its status."""

    status = 2


def zenoh_reason(error: Exception) -> str:
    """Return the first line of an error of zenoh without the places in its own sources."""
    return _SOURCE_PLACE.sub("", str(error).strip().partition("\n")[0])


def first_problem(error: "ValidationError") -> str:
    """Return the first problem of a value that is not of its model: where it is, and what is wrong."""
    problem = error.errors(include_url=False)[0]
    return f"{'.'.join(map(str, problem['loc']))}: {problem['msg']}"
