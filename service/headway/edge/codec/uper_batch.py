"""Messages of the binary feeds to a batch, column by column, without an object for each record."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from headway.core.types.batch import I64
from headway.core.types.identifiers import ID
from headway.edge.codec.decoded import NOT_THE_SENDER, Decoded, batch_of, may_send, received_us_of
from headway.edge.codec.payload import reason_of
from headway.edge.transport.message import ReceivedMessage, Rejection
from headway.feeds.identifiers import folded
from headway.feeds.uper import UperRecords, read_bsms, read_cams
from headway_schemas.encodings import CAM_UPER, J2735_UPER
from headway_schemas.frames import Frame

UPER_READERS: Final[dict[str, Callable[[Sequence[bytes], I64], UperRecords]]] = {
    J2735_UPER: read_bsms,
    CAM_UPER: read_cams,
}


@dataclass(frozen=True, slots=True)
class UperFrames:
    """N frames of one encoding, and where they come from."""

    payloads: list[bytes] = field(default_factory=list)
    received_us: list[int] = field(default_factory=list)
    sources: list[int] = field(default_factory=list)
    """Message of each frame."""
    places: list[int] = field(default_factory=list)
    """Place of each frame in its message."""
    owners: list[str] = field(default_factory=list)
    """The only sender allowed; empty for a gateway."""

    def add(self, frames: Sequence[Frame], source: int, owner: str) -> None:
        """Take the frames of one message."""
        self.payloads.extend(frame.payload for frame in frames)
        self.received_us.extend(frame.received_us for frame in frames)
        self.sources.extend([source] * len(frames))
        self.places.extend(range(len(frames)))
        self.owners.extend([folded(owner)] * len(frames))

    def decode(self, encoding: str, messages: Sequence[ReceivedMessage], rejections: list[Rejection]) -> Decoded:
        """Decode the frames; `rejections` are those of messages without frames."""
        read = UPER_READERS[encoding](self.payloads, np.array(self.received_us, np.int64))
        reasons = {i: reason_of(refusal) for i, refusal in read.refusals.items()}
        if any(self.owners):
            for i, (owner, sender) in enumerate(zip(self.owners, read.ids.tolist(), strict=True)):
                if not may_send(owner, sender.decode()):
                    reasons.setdefault(i, NOT_THE_SENDER)
        refused = [Rejection(reasons[i], messages[self.sources[i]], index=self.places[i]) for i in sorted(reasons)]
        kept = np.delete(np.arange(len(self.payloads)), list(reasons))
        numbers = {name: column[kept] for name, column in read.numbers.items()}
        numbers |= {name: np.full(kept.size, np.nan) for name in ("range_m", "range_rate_mps")}
        sources = np.array(self.sources, np.int64)[kept]
        indices = np.array(self.places, np.int64)[kept]
        received_us = received_us_of(messages)[sources]
        batch = batch_of(read.ids[kept].astype(ID), np.zeros(kept.size, ID), numbers, received_us)
        return Decoded(batch, sources, indices, rejections + refused)
