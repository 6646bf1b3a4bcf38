"""Key expressions: every address on the bus is built and read here.

A key is `<prefix>/<site>/<channel>/...`. A site is the coverage of one roadside unit; a pair lives within one site.
Chunks that come from outside (senders, instances) are identifiers, so no key can hold `@`, `*`, `$` or `//`.
"""

import re
from dataclasses import dataclass
from typing import Final, NamedTuple

ID_PATTERN: Final = "[A-Za-z0-9_.~-]{1,64}"
GATEWAY_PREFIX: Final = "gw-"
"""A sender with this prefix may carry records of others."""

_ID = re.compile(ID_PATTERN)
_NOT_IN_ID = re.compile("[^A-Za-z0-9_.~-]")
_ID_LENGTH_MAX = 64


def is_id(text: str) -> bool:
    """Whether `text` may be an identifier: 1 to 64 of letters, digits and `_ . ~ -`."""
    return _ID.fullmatch(text) is not None


def sanitise_id(text: str) -> str:
    """Make an identifier of any text: foreign characters become `_`, the rest is cut at 64; empty becomes `_`."""
    return _NOT_IN_ID.sub("_", text)[:_ID_LENGTH_MAX] or "_"


def is_gateway(sender: str) -> bool:
    """Whether the sender may carry records of others."""
    return sender.startswith(GATEWAY_PREFIX)


def has_wildcard(key: str) -> bool:
    """Whether a key stands for more than one key."""
    return "*" in key or "$" in key


class Address(NamedTuple):
    """A key of one site, taken apart: `channel` is `bsm`, `alert`, `pair`, `rejected` or `health`."""

    channel: str
    chunks: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Keys:
    """The keys of one site.

    Raises
    ------
    ValueError
        The prefix is not one or more identifiers joined by `/`, or the site is not an identifier.
    """

    prefix: str
    site: str

    def __post_init__(self) -> None:
        if not all(map(is_id, self.prefix.split("/"))):
            raise ValueError(f"key prefix {self.prefix!r}: use identifiers of {ID_PATTERN} joined by '/'")
        if not is_id(self.site):
            raise ValueError(f"site {self.site!r}: use an identifier of {ID_PATTERN}")

    def bsm(self, sender: str) -> str:
        """Where `sender` puts its basic safety messages."""
        return self._under("bsm", sender)

    def alert(self, kind: str, suspect: str) -> str:
        """Where events of this kind about `suspect` are put."""
        return self._under("alert", kind, suspect)

    def pair_state(self, follower: str) -> str:
        """Where the state of this follower's pair is put."""
        return self._under("pair", follower, "state")

    def quality(self, vehicle: str) -> str:
        """Where the quality of this vehicle's sensors is put."""
        return self._under("quality", vehicle)

    def handled(self, vehicle: str) -> str:
        """Where it is put how people handle this vehicle."""
        return self._under("handling", vehicle)

    def handover(self, origin: str, vehicle: str) -> str:
        """Where the site `origin` puts the state of a vehicle that comes to this site."""
        return self._under("handover", origin, vehicle)

    def rejected(self, reason: str) -> str:
        """Where copies of messages rejected for `reason` are put."""
        return self._under("rejected", reason)

    def health(self, instance: str) -> str:
        """Where this instance of the service reports on itself."""
        return self._under("health", instance)

    def liveliness(self, instance: str) -> str:
        """Token that exists while this instance lives; `**` does not match it."""
        _require_ids(instance)
        return f"{self.prefix}/@headway/{instance}"

    def epoch(self, epoch: int, instance: str) -> str:
        """Token that exists while this instance holds this epoch of the site."""
        _require_ids(instance)
        return f"{self.prefix}/{self.site}/@headway/{epoch}/{instance}"

    @property
    def every_epoch(self) -> str:
        """Liveliness subscription to every epoch of the site; the last chunk but one is its number."""
        return f"{self.prefix}/{self.site}/@headway/*/*"

    @property
    def every_bsm(self) -> str:
        """Subscription to every sender of the site; messages below their chunk are received and rejected."""
        return f"{self.prefix}/{self.site}/bsm/**"

    @property
    def every_alert(self) -> str:
        """Subscription to every event of the site."""
        return f"{self.prefix}/{self.site}/alert/**"

    @property
    def every_pair_state(self) -> str:
        """Subscription to the state of every pair of the site."""
        return f"{self.prefix}/{self.site}/pair/*/state"

    @property
    def every_quality(self) -> str:
        """Subscription to the quality of every vehicle's sensors."""
        return f"{self.prefix}/{self.site}/quality/*"

    @property
    def every_handled(self) -> str:
        """Subscription to how people handle vehicles."""
        return f"{self.prefix}/{self.site}/handling/*"

    @property
    def every_handover(self) -> str:
        """Subscription to vehicles that come to this site."""
        return f"{self.prefix}/{self.site}/handover/*/*"

    @property
    def every_rejected(self) -> str:
        """Subscription to every rejected copy of the site."""
        return f"{self.prefix}/{self.site}/rejected/*"

    @property
    def every_health(self) -> str:
        """Subscription to the health of every instance of the site."""
        return f"{self.prefix}/{self.site}/health/*"

    @property
    def every_liveliness(self) -> str:
        """Liveliness subscription to every instance."""
        return f"{self.prefix}/@headway/*"

    @property
    def alerts(self) -> str:
        """Queryable: the history of events, by time and kind."""
        return f"{self.prefix}/{self.site}/alerts"

    @property
    def handling(self) -> str:
        """Queryable: how people handle vehicles, and requests to do so."""
        return f"{self.prefix}/{self.site}/handling"

    @property
    def pairs(self) -> str:
        """Queryable: the live state of every pair."""
        return f"{self.prefix}/{self.site}/pairs"

    def parse(self, key: str) -> Address | None:
        """Take a key of this site apart; None where it is not one that this class builds."""
        head, _, tail = key.removeprefix(f"{self.prefix}/{self.site}/").partition("/")
        chunks = tuple(tail.split("/"))
        if f"{self.prefix}/{self.site}/{head}/{tail}" != key or not all(map(is_id, chunks)):
            return None
        match head, chunks:
            case ("bsm" | "rejected" | "health", (_,)) | ("alert", (_, _)):
                return Address(head, chunks)
            case "pair", (follower, "state"):
                return Address(head, (follower,))
            case _:
                return None

    def _under(self, *chunks: str) -> str:
        _require_ids(*chunks)
        return "/".join((self.prefix, self.site, *chunks))


def _require_ids(*chunks: str) -> None:
    for chunk in chunks:
        if not is_id(chunk):
            raise ValueError(f"key chunk {chunk!r}: use an identifier of {ID_PATTERN}")
