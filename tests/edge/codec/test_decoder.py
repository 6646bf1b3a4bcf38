import dataclasses
import json
import math
from typing import Any

import msgpack
import numpy as np
import pytest
from edge.codec.messages import GATEWAY, KEYS, RECEIVED_US, as_map, ids_of, received, record

from headway.core.types.batch import Batch
from headway.core.types.outcome import Outcome
from headway.core.types.records import Kind, Sensor
from headway.core.types.step_result import Phase
from headway.edge.codec import decoder as codec_module
from headway.edge.codec.decoded import Decoded
from headway.edge.codec.decoder import Codec
from headway.edge.codec.messages import encode, rejected_copy
from headway.edge.transport.message import ReceivedMessage, Rejection, RejectReason
from headway_schemas import event
from headway_schemas.encodings import BSM_JSON, BSM_MSGPACK
from headway_schemas.state import RejectedCopy

FULL = {
    "elev_m": 260.0,
    "accel_mps2": -0.5,
    "accuracy_m": 1.5,
    "length_m": 4.6,
    "width_m": 1.9,
    "leader": ["b", 22.0, -0.3],
}


def decode(*received_messages: ReceivedMessage, **limits: int) -> Decoded:
    return Codec(KEYS, **limits).decode(received_messages)


def reasons(decoded: Decoded) -> list[Outcome]:
    return [rejection.reason.outcome for rejection in decoded.rejections]


def assert_equal(one: Batch, other: Batch) -> None:
    for field in dataclasses.fields(Batch):
        np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name), err_msg=field.name)


def test_a_compact_record_becomes_one_row_of_columns() -> None:
    batch = decode(received(record(**FULL))).batch
    assert {field.name: list(getattr(batch, field.name)) for field in dataclasses.fields(Batch)} == {
        "ids": [b"a"],
        "leader_ids": [b"b"],
        "msg_cnt": [7],
        "t_us": [RECEIVED_US - 20_000],
        "received_us": [RECEIVED_US],
        "lat_deg": [42.3],
        "lon_deg": [-83.7],
        "speed_mps": [13.5],
        "heading_deg": [90.0],
        "accel_mps2": [-0.5],
        "accuracy_m": [1.5],
        "length_m": [4.6],
        "range_m": [22.0],
        "range_rate_mps": [-0.3],
    }
    assert batch.t_us.dtype == batch.msg_cnt.dtype == batch.received_us.dtype == np.int64


def test_what_the_sender_does_not_know_is_nan() -> None:
    batch = decode(received(record(heading_deg=None)[:7])).batch
    assert ids_of(batch.leader_ids) == [None]
    for name in ("heading_deg", "accel_mps2", "accuracy_m", "length_m", "range_m", "range_rate_mps"):
        assert np.isnan(getattr(batch, name)).all()


def test_every_form_of_a_message_says_the_same() -> None:
    fields = record(**FULL)
    expected = decode(received(fields)).batch
    for content, encoding in [(as_map(fields), BSM_MSGPACK), (fields, BSM_JSON), (as_map(fields), BSM_JSON)]:
        assert_equal(decode(received(content, encoding=encoding)).batch, expected)
        assert_equal(decode(received([content], encoding=encoding)).batch, expected)


def test_integers_are_read_where_a_number_is_meant() -> None:
    batch = decode(received(record(lat=42, lon=-83, speed_mps=0, leader=["b", 10, 0]))).batch
    assert (batch.lat_deg[0], batch.speed_mps[0], batch.range_m[0]) == (42.0, 0.0, 10.0)


def test_records_of_one_turn_keep_their_order_and_know_their_arrival() -> None:
    decoded = decode(
        received(record("a")),
        received([record("b"), as_map(record("c", leader=["b"]))], GATEWAY),
        received(b"", "x"),
        received(record("d"), "d", BSM_JSON),
    )
    assert ids_of(decoded.batch.ids) == ["a", "b", "c", "d"]
    assert ids_of(decoded.batch.leader_ids) == [None, None, "b", None]
    assert decoded.sources.tolist() == [0, 1, 1, 3]
    assert reasons(decoded) == [Outcome.MALFORMED]


def test_nothing_in_nothing_out() -> None:
    decoded = decode()
    assert len(decoded.batch) == len(decoded.rejections) == decoded.sources.size == 0


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"v": 2}, Outcome.WRONG_VERSION),
        ({"v": None}, Outcome.WRONG_VERSION),
        ({"v": True}, Outcome.WRONG_VERSION),
        ({"v": 2, "speed_mps": "fast"}, Outcome.WRONG_VERSION),
        ({"speed_mps": "13.5"}, Outcome.MALFORMED),
        ({"speed_mps": True}, Outcome.MALFORMED),
        ({"msg_cnt": 7.0}, Outcome.MALFORMED),
        ({"t_us": 1.5e15}, Outcome.MALFORMED),
        ({"heading_deg": [1.0]}, Outcome.MALFORMED),
        ({"heading_deg": {}}, Outcome.MALFORMED),
        ({"id": 7}, Outcome.MALFORMED),
        ({"id": ["a"]}, Outcome.MALFORMED),
        ({"id": "a/b"}, Outcome.MALFORMED),
        ({"id": b"a"}, Outcome.MALFORMED),
        ({"leader": "b"}, Outcome.MALFORMED),
        ({"leader": {"id": "b"}}, Outcome.MALFORMED),
        ({"v": 2, "leader": {"id": "b"}}, Outcome.WRONG_VERSION),
        ({"leader": ["b", 1.0, 1.0, 1.0]}, Outcome.MALFORMED),
        ({"leader": ["b*"]}, Outcome.MALFORMED),
        ({"lat": math.nan}, Outcome.NOT_FINITE),
        ({"elev_m": math.nan}, Outcome.NOT_FINITE),
        ({"speed_mps": math.inf}, Outcome.NOT_FINITE),
        ({"leader": ["b", math.nan]}, Outcome.NOT_FINITE),
        ({"id": None}, Outcome.UNAVAILABLE),
        ({"msg_cnt": None}, Outcome.UNAVAILABLE),
        ({"t_us": None}, Outcome.UNAVAILABLE),
        ({"lat": None}, Outcome.UNAVAILABLE),
        ({"lon": None}, Outcome.UNAVAILABLE),
        ({"speed_mps": None}, Outcome.UNAVAILABLE),
        ({"leader": []}, Outcome.UNAVAILABLE),
        ({"speed_mps": 8191 * 0.02}, Outcome.OUT_OF_RANGE),
        ({"msg_cnt": 128}, Outcome.OUT_OF_RANGE),
        ({"t_us": -1}, Outcome.OUT_OF_RANGE),
        ({"lat": 2**63}, Outcome.OUT_OF_RANGE),
        ({"heading_deg": 360.0}, Outcome.OUT_OF_RANGE),
        ({"length_m": 0.0}, Outcome.OUT_OF_RANGE),
        ({"leader": ["b", -1.0]}, Outcome.OUT_OF_RANGE),
        ({"leader": ["a", 10.0]}, Outcome.OUT_OF_RANGE),
        ({"id": "b"}, Outcome.IDENTITY_MISMATCH),
        ({"lat": math.nan, "lon": None, "speed_mps": 999.0}, Outcome.NOT_FINITE),
    ],
)
def test_a_bad_record_is_named_and_its_neighbours_live(changes: dict[str, Any], reason: Outcome) -> None:
    good = record("c", elev_m=1.0, leader=["d", 5.0])
    decoded = decode(received(good, "c"), received(record(**changes)), received(good, "c"))
    assert reasons(decoded) == [reason]
    assert decoded.rejections[0].index == 0
    assert ids_of(decoded.batch.ids) == ["c", "c"]
    assert ids_of(decoded.batch.leader_ids) == ["d", "d"]
    assert decoded.batch.range_m.tolist() == [5.0, 5.0]


def test_a_bad_record_of_a_bundle_goes_alone() -> None:
    bundle = [record("a"), record("b", speed_mps=999.0), "junk", record("c"), as_map(record("d")) | {"colour": 1}]
    message = received(bundle, GATEWAY)
    decoded = decode(received(record("x"), "x"), message)
    assert ids_of(decoded.batch.ids) == ["x", "a", "c"]
    assert [(r.reason.outcome, r.index, r.count) for r in decoded.rejections] == [
        (Outcome.OUT_OF_RANGE, 1, 1),
        (Outcome.MALFORMED, 2, 1),
        (Outcome.MALFORMED, 4, 1),
    ]
    assert all(rejection.message is message for rejection in decoded.rejections)


def test_only_a_gateway_carries_records_of_others() -> None:
    bundle = [record("a"), record("b")]
    assert ids_of(decode(received(bundle, GATEWAY)).batch.ids) == ["a", "b"]
    decoded = decode(received(bundle, "a"))
    assert ids_of(decoded.batch.ids) == ["a"]
    assert [(r.reason.outcome, r.index) for r in decoded.rejections] == [(Outcome.IDENTITY_MISMATCH, 1)]


def test_a_field_that_version_1_does_not_have_is_no_field() -> None:
    known, long = as_map(record()), [*record(leader=["b"]), 1]
    coloured, listed = {"leader": {"id": "b", "colour": "red"}}, {"leader": ["b"]}
    for content in (known | {"colour": "red"}, known | coloured, known | listed, long):
        assert reasons(decode(received(content))) == [Outcome.MALFORMED]
    for content in (known | {"v": 2, "colour": "red"}, known | {"v": 2} | coloured, [2, *long[1:]]):
        assert reasons(decode(received(content))) == [Outcome.WRONG_VERSION]


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (received(record(), is_put=False), Outcome.NOT_A_PUT),
        (received(b"", is_put=False), Outcome.NOT_A_PUT),
        (received(record(), key="v2x/s/bsm/*"), Outcome.WILDCARD_KEY),
        (received(record(), key="v2x/s/**"), Outcome.WILDCARD_KEY),
        (received(record(), key="v2x/s/bsm/a$*"), Outcome.WILDCARD_KEY),
        (received(record(), key="v2x/s/bsm/a/b"), Outcome.IDENTITY_MISMATCH),
        (received(record(), key="v2x/other/bsm/a"), Outcome.IDENTITY_MISMATCH),
        (received(record(), key="v2x/s/health/a"), Outcome.IDENTITY_MISMATCH),
        (received(record(), encoding="zenoh/bytes"), Outcome.UNKNOWN_ENCODING),
        (received(record(), encoding="application/json;bsm.v2"), Outcome.UNKNOWN_ENCODING),
        (received(bytes(1001)), Outcome.PAYLOAD_TOO_LARGE),
    ],
)
def test_what_is_wrong_before_the_payload_is_read(message: ReceivedMessage, reason: Outcome) -> None:
    codec = Codec(KEYS, payload_max_bytes=1000)
    for _ in range(2):  # the second time the sender is known
        decoded = codec.decode([received(record()), message])
        assert reasons(decoded) == [reason]
        assert (decoded.rejections[0].index, decoded.rejections[0].count) == (None, 1)
        assert ids_of(decoded.batch.ids) == ["a"]


def test_senders_that_rotate_their_ids_do_not_fill_the_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(codec_module, "_CACHED_MAX", 10)
    codec = Codec(KEYS)
    for i in range(50):
        decoded = codec.decode([received(record(f"v{i}", leader=[f"w{i}"]), f"v{i}")])
        assert ids_of(decoded.batch.ids) == [f"v{i}"]
    assert max(len(codec._owners), len(codec._ids)) <= 10


@pytest.mark.parametrize("encoding", [BSM_MSGPACK, BSM_JSON])
@pytest.mark.parametrize(
    ("content", "count"),
    [
        (record(), 1),
        (as_map(record()), 1),
        ([record()], 1),
        ([record(), as_map(record()), 7], 3),
        ([record()] * 600, 600),
        (b"\xc1", 1),
    ],
    ids=["record", "map", "bundle of one", "bundle of three", "bundle too large", "garbage"],
)
def test_what_is_never_decoded_counts_as_much_as_if_it_were(content: object, count: int, encoding: str) -> None:
    message = received(content, encoding=encoding)
    decoded = decode(message)
    assert Codec(KEYS).records_in([message]) == count
    assert len(decoded.batch) + sum(rejection.count for rejection in decoded.rejections) == count


def test_a_copy_of_a_rejected_message_is_cut_and_can_be_printed() -> None:
    payload = b"\xc1" * 100
    message = ReceivedMessage("v2x/s/bsm/ä" + "x" * 1000, payload, "text/\udc80", True, RECEIVED_US, 0)
    copy = rejected_copy(Rejection(RejectReason(Outcome.MALFORMED, "why"), message, count=3), payload_max_bytes=10)
    wire = json.loads(encode(copy))
    assert RejectedCopy.model_validate_json(encode(copy)) == copy
    assert (copy.payload, copy.size, copy.truncated, copy.count) == (payload[:10], 100, True, 3)
    assert wire["reason"] == "malformed"
    assert wire["key"].startswith("v2x/s/bsm/\\xe4xxx")
    assert len(wire["key"]) < 300
    assert wire["encoding"] == "text/\\udc80"


def test_a_copy_names_the_sender_where_the_key_does() -> None:
    reason = RejectReason(Outcome.MALFORMED, "why")
    assert rejected_copy(Rejection(reason, received(b"")), payload_max_bytes=10).sender == "a"
    assert rejected_copy(Rejection(reason, received(b"", key="v2x/s/bsm/*")), payload_max_bytes=10).sender is None


def test_the_detail_repeats_nothing_that_the_sender_wrote() -> None:
    for changes in ({"speed_mps": "<secret>"}, {"id": "<secret>"}, {"leader": ["<secret>"]}):
        detail = decode(received(record(**changes))).rejections[0].reason.detail
        assert next(iter(changes)) in detail
        assert "secret" not in detail
    assert "secret" not in decode(received(as_map(record()) | {"<secret>": 1})).rejections[0].reason.detail


def test_every_reason_makes_a_label_of_the_wire() -> None:
    for reason in (outcome for outcome in Outcome if outcome.is_rejection):
        rejected_copy(Rejection(RejectReason(reason, ""), received(b"")), payload_max_bytes=0)


def test_core_and_wire_use_the_same_words() -> None:
    assert {kind.label for kind in Kind} - {"none"} == set(event.Kind)
    assert {sensor.label for sensor in Sensor} - {"none"} == set(event.Sensor)
    assert set(Phase) == set(event.Phase)


def test_msgpack_is_read_as_the_library_writes_it() -> None:
    single_precision = msgpack.packb(record(), use_single_float=True)
    assert decode(received(single_precision)).batch.lat_deg[0] == np.float32(42.3)


@pytest.mark.parametrize("field", ["msg_cnt", "t_us", "lat", "speed_mps", "elev_m"])
def test_an_integer_beyond_a_double_rejects_its_record_and_spoils_no_other(field: str) -> None:
    decoded = Codec(KEYS).decode([received([record(**{field: 10**400}), record("b")], "gw-1", BSM_JSON)])
    assert ids_of(decoded.batch.ids) == ["b"]
    assert [(one.reason.outcome, one.index) for one in decoded.rejections] == [(Outcome.OUT_OF_RANGE, 0)]
