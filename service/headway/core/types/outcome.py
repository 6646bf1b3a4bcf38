"""The outcomes of a record: a closed set, and each name is the label of a metric.

Each record that arrives has exactly one `Outcome`. `SCORED` and `WARMING` come from the filter; the others are
rejections, and the name is the reason. The numbers are for arrays only. The names are the contract: a retired name is
never used again.
"""

from enum import IntEnum, unique


@unique
class Outcome(IntEnum):
    """The closed set of outcomes; `label` is the word on the wire, in metrics and in the docs."""

    SCORED = 0
    WARMING = 1

    # By the codec, from the bytes alone.
    MALFORMED = 10
    WRONG_VERSION = 11
    OUT_OF_RANGE = 12
    NOT_FINITE = 13
    UNAVAILABLE = 14
    IDENTITY_MISMATCH = 15
    WILDCARD_KEY = 16
    NOT_A_PUT = 17
    BUNDLE_TOO_LARGE = 18
    PAYLOAD_TOO_LARGE = 19
    UNKNOWN_ENCODING = 20
    OTHER_MESSAGE = 21
    UNREADABLE_TIME = 22

    # By the core, from the state of the sender.
    TOO_OLD = 30
    FROM_THE_FUTURE = 31
    DUPLICATE = 32
    OUT_OF_ORDER = 33
    TABLE_FULL = 34
    CONTRADICTION = 35
    DETECTOR_FAILED = 36

    # By the loop, under overload.
    SHED = 40
    STALE = 41
    RATE_EXCEEDED = 42

    @property
    def label(self) -> str:
        """The name in lower case: metric label, key chunk of the rejected topic, JSON key."""
        return self.name.lower()

    @property
    def is_rejection(self) -> bool:
        """Whether the record never reached a filter."""
        return self > Outcome.WARMING


LOSSES = (Outcome.SHED, Outcome.STALE, Outcome.RATE_EXCEEDED)
"""Records dropped before decoding: the queue was full, they waited for too long, or their sender sends too many."""

REJECTIONS = tuple(o for o in Outcome if o.is_rejection)
