"""Errors that the user of a command can repair."""

import re
from typing import Final

_SOURCE_PLACE: Final = re.compile(r" at /\S+\.rs:\d+\.?")


class UserError(Exception):
    """One line: what is wrong and what to do. A command that raises it ends with status 2."""


def zenoh_reason(error: Exception) -> str:
    """Return the first line of an error of zenoh without the places in its own sources."""
    return _SOURCE_PLACE.sub("", str(error).strip().partition("\n")[0])
