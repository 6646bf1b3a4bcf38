"""Why a message of another system is no record."""

from typing import Any, Final, NamedTuple, TypeAlias

MALFORMED: Final = "malformed"
OTHER_MESSAGE: Final = "other_message"
OUT_OF_RANGE: Final = "out_of_range"
UNAVAILABLE: Final = "unavailable"
UNREADABLE_TIME: Final = "unreadable_time"


class Refusal(NamedTuple):
    """A message that is no record; `detail` holds no text of the sender."""

    reason: str
    """One of the names above, which are outcomes of the service."""
    detail: str


Result: TypeAlias = list[Any] | Refusal
"""A compact record, whose values are converted and not validated, or why there is none."""
