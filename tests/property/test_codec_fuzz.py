"""Whatever comes in, each record ends in the batch or in one rejection, and the columns judge as the model does."""

import json
import math
from typing import Any

import msgpack
import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st
from pydantic import ValidationError

from headway.core.types.batch import Batch
from headway.core.types.outcome import REJECTIONS
from headway.edge.codec.decoded import Decoded
from headway.edge.codec.decoder import Codec
from headway.edge.codec.messages import encode, rejected_copy
from headway.edge.transport.message import ReceivedMessage
from headway_schemas import Bsm, Keys
from headway_schemas.bsm import FIELDS, from_record, to_map, to_record
from headway_schemas.encodings import BSM_JSON, BSM_MSGPACK, J2735_ODE, J2735_RAW

KEYS = Keys("v2x", "s")
ENCODINGS = (BSM_MSGPACK, BSM_JSON, J2735_RAW, J2735_ODE)
SENDERS = ("a", "b", "gw-1")


def number(low: float, high: float) -> st.SearchStrategy[Any]:
    """Numbers at, just inside and just outside of the bounds, and anywhere between."""
    edges = [
        x for bound in (low, high) for x in (bound, math.nextafter(bound, -math.inf), math.nextafter(bound, math.inf))
    ]
    return st.sampled_from(edges) | st.floats(low, high) | st.integers(math.floor(low), math.ceil(high))


INTEGER = st.integers(-(2**63), 2**64 - 1)
ODD = st.one_of(
    st.none(),
    st.booleans(),
    st.sampled_from([math.nan, math.inf, -math.inf, 2**53, 2**53 + 1, 2**63, -(2**63), -0.0]),
    st.floats(),
    INTEGER,
    st.text(max_size=3),
    st.binary(max_size=3),
    st.lists(st.integers(0, 3), max_size=4),
    st.dictionaries(st.text(max_size=2), INTEGER, max_size=2),
)
ID = st.sampled_from([*SENDERS, "x" * 64, "x" * 65, "", "a/b", "@", "a\n", "ä"])
FIELD = {
    "v": st.sampled_from([0, 1, 2]),
    "id": ID,
    "msg_cnt": st.integers(-1, 128),
    "t_us": st.integers(-1, 2) | st.integers(2**53 - 2, 2**53 + 1),
    "lat": number(-90.0, 90.0),
    "lon": number(-180.0, 180.0),
    "speed_mps": number(0.0, 163.8),
    "heading_deg": number(0.0, 360.0),
    "elev_m": number(-409.5, 6143.9),
    "accel_mps2": number(-20.0, 20.0),
    "accuracy_m": number(0.0, 12.7),
    "length_m": number(0.0, 40.95),
    "width_m": number(0.0, 10.23),
    "leader": st.tuples(ID, number(0.0, 1000.0) | ODD, number(-327.6, 327.6) | ODD).map(list) | st.just({"id": "z"}),
}
NULLABLE = ("heading_deg", "elev_m", "accel_mps2", "accuracy_m", "length_m", "width_m")
SPARSE = [1, "a", 0, 0, 0.0, 0.0, 0.0, *[None] * 7]
DENSE = [1, "b", 127, 2**53 - 1, 42.3, -83.7, 13.5, 90.0, 260.0, -0.5, 1.5, 4.6, 1.9, ["z", 20.0, 0]]


@st.composite
def borderline_record(draw: st.DrawFn) -> list[Any]:
    """Return a good record with up to three fields near a limit or odd, at times of another length."""
    record = list(draw(st.sampled_from([SPARSE, DENSE])))
    for name in draw(st.lists(st.sampled_from(FIELDS), max_size=3, unique=True)):
        record[FIELDS.index(name)] = draw(FIELD[name] | ODD)
    if draw(st.integers(0, 9)) == 0:
        record = [*record, None][: draw(st.integers(0, len(FIELDS) + 1))]
    return record


@st.composite
def good_bsm(draw: st.DrawFn) -> Bsm:
    """Return a message that the model accepts."""
    optional = st.none() | st.floats(0.01, 10.0)
    leader = st.none() | st.fixed_dictionaries({"id": st.just("z"), "range_m": optional, "range_rate_mps": optional})
    return Bsm(
        v=1,
        id=draw(st.sampled_from(SENDERS)),
        msg_cnt=draw(st.integers(0, 127)),
        t_us=draw(st.integers(0, 2**53 - 1)),
        lat=draw(st.floats(-90.0, 90.0)),
        lon=draw(st.floats(-180.0, 180.0)),
        speed_mps=draw(st.floats(0.0, 163.8)),
        leader=draw(leader),
        **{name: draw(optional) for name in NULLABLE},
    )


def received(payload: bytes, encoding: str, key: str = KEYS.bsm("gw-1")) -> ReceivedMessage:
    return ReceivedMessage(key, payload, encoding, is_put=True, received_us=1_700_000_000_000_000, received_ns=0)


def rows(batch: Batch) -> list[tuple[object, ...]]:
    columns = (getattr(batch, name) for name in Batch.__dataclass_fields__)
    return list(zip(*(c.tolist() if isinstance(c, np.ndarray) else c for c in columns), strict=True))


def assert_accounted(decoded: Decoded, records: int) -> None:
    assert len(decoded.batch) + sum(rejection.count for rejection in decoded.rejections) == records
    assert len(decoded.sources) == len(decoded.batch)
    for rejection in decoded.rejections:
        assert rejection.reason.outcome in REJECTIONS
        encode(rejected_copy(rejection, payload_max_bytes=100))


@given(st.lists(st.tuples(st.binary(max_size=60), st.sampled_from([*ENCODINGS, ""]), st.booleans()), max_size=5))
def test_any_bytes_are_accounted_for(payloads: list[tuple[bytes, str, bool]]) -> None:
    codec = Codec(KEYS)
    for payload, encoding, is_put in payloads:
        decoded = codec.decode([received(payload, encoding)._replace(is_put=is_put)])
        assert len(decoded.batch) + len(decoded.rejections) >= 1
        assert_accounted(decoded, len(decoded.batch) + sum(r.count for r in decoded.rejections))


@given(st.text(max_size=30) | st.text("v2xsbm/*$@#?a", max_size=20).map("v2x/s/bsm/".__add__))
def test_any_key_is_accounted_for(key: str) -> None:
    record = msgpack.packb([1, "a", 0, 0, 0.0, 0.0, 0.0])
    decoded = Codec(KEYS).decode([received(record, BSM_MSGPACK, key)])
    assert_accounted(decoded, 1)
    assert decoded.rejections or key == "v2x/s/bsm/a" or key.startswith("v2x/s/bsm/gw-")


@given(st.lists(borderline_record() | ODD, min_size=1, max_size=8), st.sampled_from([BSM_MSGPACK, BSM_JSON]))
def test_every_record_of_a_bundle_is_accounted_for(records: list[Any], encoding: str) -> None:
    bundle = [[], *records]  # an array first makes it a bundle
    payload = msgpack.packb(bundle) if encoding == BSM_MSGPACK else json.dumps(bundle, default=str).encode()
    decoded = Codec(KEYS).decode([received(payload, encoding)])
    assert_accounted(decoded, len(bundle))
    assert len({rejection.index for rejection in decoded.rejections}) == len(decoded.rejections)


@given(st.recursive(ODD, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(
    ["coreData", "payload", "data", "value", "metadata", "recordGeneratedAt", "secMark", "lat", "size", "position"]
), inner, max_size=5)), st.sampled_from([J2735_RAW, J2735_ODE]))  # fmt: skip
@example({"coreData": {"secMark": 0}, "metadata": {"recordGeneratedAt": "0001-01-01T00:00:00+23:59"}}, J2735_ODE)
@example({"coreData": {"secMark": 0}, "metadata": {"recordGeneratedAt": "9999-12-31T23:59:59-23:59"}}, J2735_ODE)
def test_any_j2735_message_is_accounted_for(message: Any, encoding: str) -> None:
    count = len(message) if isinstance(message, list) and message else 1
    decoded = Codec(KEYS).decode([received(json.dumps(message, default=str).encode(), encoding)])
    assert_accounted(decoded, count)


@given(st.lists(borderline_record(), min_size=1, max_size=6))
def test_the_columns_accept_what_the_model_accepts(records: list[list[Any]]) -> None:
    decoded = Codec(KEYS).decode([received(msgpack.packb([[], *records]), BSM_MSGPACK)])
    accepted = set(range(len(records))) - {(rejection.index or 0) - 1 for rejection in decoded.rejections}
    assert accepted == {i for i, record in enumerate(records) if _model_accepts(record)}


@given(st.lists(good_bsm(), min_size=1, max_size=5))
def test_every_form_of_a_message_decodes_to_the_same_numbers(messages: list[Bsm]) -> None:
    records, maps = [to_record(bsm) for bsm in messages], [to_map(bsm) for bsm in messages]
    codec = Codec(KEYS)
    expected = [
        (
            bsm.id.encode(), bsm.leader.id.encode() if bsm.leader else b"",
            bsm.msg_cnt, bsm.t_us, 1_700_000_000_000_000, bsm.lat, bsm.lon, bsm.speed_mps,
            bsm.heading_deg, bsm.accel_mps2, bsm.accuracy_m, bsm.length_m,
            bsm.leader and bsm.leader.range_m, bsm.leader and bsm.leader.range_rate_mps,
        )
        for bsm in messages
    ]  # fmt: skip
    for form in (records, maps):
        for payload, encoding in ((msgpack.packb(form), BSM_MSGPACK), (json.dumps(form).encode(), BSM_JSON)):
            decoded = codec.decode([received(payload, encoding)])
            assert [tuple(None if repr(v) == "nan" else v for v in row) for row in rows(decoded.batch)] == expected


@given(st.lists(borderline_record(), min_size=1, max_size=8))
def test_a_record_has_the_same_outcome_alone_and_among_others(records: list[list[Any]]) -> None:
    payloads = [received(msgpack.packb([record]), BSM_MSGPACK, KEYS.bsm("a")) for record in records]
    together = Codec(KEYS).decode(payloads)
    alone = [Codec(KEYS).decode([payload]) for payload in payloads]
    assert repr(rows(together.batch)) == repr([row for decoded in alone for row in rows(decoded.batch)])
    assert [r.reason for r in together.rejections] == [r.reason for decoded in alone for r in decoded.rejections]


def _model_accepts(record: list[Any]) -> bool:
    try:
        from_record(record)
    except (ValidationError, ValueError):
        return False
    return True
