"""Frames to payloads: compact msgpack records, one message each or in bundles, grouped by intended send time."""

from collections.abc import Iterable, Iterator
from itertools import pairwise, repeat
from typing import NamedTuple

import msgpack
import numpy as np
import zenoh

from headway_loadtest.sources.drive import I64
from headway_loadtest.traffic.frames import Frame
from headway_loadtest.traffic.schedule import Schedule
from headway_schemas.bsm import WIRE_VERSION
from headway_schemas.keys import GATEWAY_PREFIX, Keys

GATEWAY = f"{GATEWAY_PREFIX}load"


class Batch(NamedTuple):
    """Payloads that are due at one time, with the key and the number of records of each. `rows` are the senders."""

    due_ns: int
    keys: list[zenoh.KeyExpr]
    payloads: list[bytes]
    records: list[int]
    rows: I64
    last_event_us: int


class Encoder:
    """Payloads for the senders of a site; `bundle` records to a payload, above 1 on a gateway's key.

    `ids` are the senders by row, the newest where they rotate, and `ids_ever` all of them.
    Packing a record costs 0.3 us, putting it on the bus ten times as much, so byte templates would not help.
    """

    def __init__(self, keys: Keys, *, bundle: int = 1) -> None:
        self._keys = keys
        self._bundle = bundle
        self._pack = msgpack.Packer().pack
        self.ids: list[str] = []
        self.ids_ever: set[str] = set()
        self._lengths: list[float | None] = []
        self._sender_keys: list[zenoh.KeyExpr] = []
        self._gateway_key = zenoh.KeyExpr(keys.bsm(GATEWAY))

    def batches(self, frames: Iterable[Frame], schedule: Schedule) -> Iterator[Batch]:
        """Yield the batches of frames, in order; what is due later is encoded when it is asked for."""
        for frame in frames:
            self._add_senders(frame)
            due_ns = schedule.due_ns(frame.t_us)
            event_us = schedule.event_us(frame.t_us)
            bounds = [0, *(np.flatnonzero(np.diff(due_ns)) + 1).tolist(), len(due_ns)]
            for start, stop in pairwise(bounds):
                if stop > start:
                    yield self._batch(frame, slice(start, stop), int(due_ns[start]), event_us)

    def _add_senders(self, frame: Frame) -> None:
        for row, vehicle, length_m in frame.entering:
            missing = row + 1 - len(self.ids)
            if missing > 0:
                self.ids.extend([""] * missing)
                self._lengths.extend([None] * missing)
                self._sender_keys.extend([self._gateway_key] * missing)
            self.ids[row] = vehicle
            self.ids_ever.add(vehicle)
            self._lengths[row] = length_m
            self._sender_keys[row] = zenoh.KeyExpr(self._keys.bsm(vehicle))

    def _batch(self, frame: Frame, part: slice, due_ns: int, event_us: I64) -> Batch:
        rows = frame.row[part]
        senders = rows.tolist()
        records = list(
            zip(
                repeat(WIRE_VERSION),
                [self.ids[row] for row in senders],
                frame.msg_cnt[part].tolist(),
                event_us[part].tolist(),
                frame.lat[part].tolist(),
                frame.lon[part].tolist(),
                frame.speed_mps[part].tolist(),
                [None if heading != heading else heading for heading in frame.heading_deg[part].tolist()],  # noqa: PLR0124
                repeat(None),
                repeat(None),
                repeat(None),
                [self._lengths[row] for row in senders],
                *(() if frame.leader is None else (repeat(None), frame.leader[part])),
                strict=False,
            )
        )
        if self._bundle > 1:
            starts = range(0, len(records), self._bundle)
            payloads = [self._pack(records[start : start + self._bundle]) for start in starts]
            keys = [self._gateway_key] * len(payloads)
            sizes = [min(self._bundle, len(records) - start) for start in starts]
        else:
            payloads = list(map(self._pack, records))
            keys = [self._sender_keys[row] for row in senders]
            sizes = [1] * len(payloads)
        return Batch(due_ns, keys, payloads, sizes, rows, int(event_us[part.stop - 1]))
