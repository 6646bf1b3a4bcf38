"""What decoding yields: a batch, where its records come from, and what is rejected."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from operator import itemgetter
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from headway.core.types.batch import F64, I64, Batch, Ids
from headway.core.types.outcome import Outcome
from headway.edge.transport.message import ReceivedMessage, Rejection, RejectReason

NOT_THE_SENDER: Final = RejectReason(Outcome.IDENTITY_MISMATCH, "id is not the sender that the key names")
ANY_SENDER: Final = ""
"""Owner of a gateway's key: its records may have any sender."""
_RECEIVED_US: Final = itemgetter(ReceivedMessage._fields.index("received_us"))


@dataclass(frozen=True, slots=True)
class Decoded:
    """The decoded messages of one loop iteration."""

    batch: Batch
    sources: I64
    """(B,) for each record of the batch, the index of its message."""
    indices: I64
    """(B,) for each record, its index in the payload of that message."""
    rejections: list[Rejection]


@dataclass(frozen=True, slots=True)
class DecodedRecords:
    """R records that came in no message, taken apart."""

    batch: Batch
    places: NDArray[np.intp]
    """(B,) of the batch's records among the R."""
    reasons: list[tuple[int, RejectReason]]
    """Place of each other one, and why it is rejected."""


def received_us_of(messages: Sequence[ReceivedMessage]) -> I64:
    """Return (M,) the receive times of messages."""
    return np.fromiter(map(_RECEIVED_US, messages), np.int64, len(messages))


def indices_in(sizes: I64) -> I64:
    """Return (R,) the index of each record in its payload, for payloads of (P,) `sizes` records."""
    indices: I64 = np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    return indices


def batch_of(ids: Ids, leader_ids: Ids, numbers: dict[str, F64], received_us: I64) -> Batch:
    """Return the batch of columns by the names of the wire."""
    return Batch(
        ids=ids,
        leader_ids=leader_ids,
        msg_cnt=numbers["msg_cnt"].astype(np.int64),
        t_us=numbers["t_us"].astype(np.int64),
        received_us=received_us,
        lat_deg=numbers["lat"],
        lon_deg=numbers["lon"],
        speed_mps=numbers["speed_mps"],
        heading_deg=numbers["heading_deg"],
        accel_mps2=numbers["accel_mps2"],
        accuracy_m=numbers["accuracy_m"],
        length_m=numbers["length_m"],
        range_m=numbers["range_m"],
        range_rate_mps=numbers["range_rate_mps"],
    )


def joined(parts: Sequence[Decoded]) -> Decoded:
    """Join what was decoded, in the order of the messages."""
    sources = np.concatenate([part.sources for part in parts])
    order = np.argsort(sources, kind="stable")
    columns = {
        field.name: np.concatenate([getattr(part.batch, field.name) for part in parts])[order]
        for field in fields(Batch)
    }
    indices = np.concatenate([part.indices for part in parts])
    rejections = [one for part in parts for one in part.rejections]
    return Decoded(Batch(**columns), sources[order], indices[order], rejections)


def may_send(owner: str, sender: Any) -> bool:
    """Whether a key of this owner may carry a record of this sender."""
    return owner in (ANY_SENDER, sender)
