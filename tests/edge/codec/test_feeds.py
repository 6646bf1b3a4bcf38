"""Messages of other systems through the codec: bundles of gateways, several encodings in one batch."""

import random

import pytest
from edge.codec.messages import GATEWAY, KEYS, RECEIVED_US, ids_of, received, record
from feeds.asn1_modules import encode_bsm, encode_cam, frame_of
from feeds.made_messages import bsm_core, cam

from headway.core.types.outcome import Outcome
from headway.edge.codec.decoder import Codec
from headway_schemas.encodings import BSM_JSON, BSM_MSGPACK, CAM_JSON, CAM_UPER, J2735_ODE, J2735_RAW, J2735_UPER
from headway_schemas.frames import Frame, pack

RNG = random.Random(11)
CORE = bsm_core(RNG) | {"secMark": 14_300, "lat": 423_000_001, "long": -837_000_002, "speed": 675}


def frame(number: int, **changes: object) -> bytes:
    return encode_bsm(CORE | {"id": bytes([36, 239, 0, number]), "msgCnt": number} | changes)


def bundle(*payloads: bytes, received_us: int = RECEIVED_US) -> bytes:
    return pack([Frame(payload, received_us, "10.0.0.7") for payload in payloads])


def test_a_bundle_of_uper_is_decoded_and_each_record_accounted_for() -> None:
    payload = bundle(frame(1), b"", frame(2, speed=8191), frame_of(bytes(90), 31), frame(3))
    decoded = Codec(KEYS).decode([received(payload, GATEWAY, J2735_UPER)])
    assert ids_of(decoded.batch.ids) == ["24EF0001", "24EF0003"]
    assert decoded.batch.speed_mps.tolist() == [13.5, 13.5]
    assert decoded.batch.received_us.tolist() == [RECEIVED_US] * 2
    assert [(one.reason.outcome, one.index) for one in decoded.rejections] == [
        (Outcome.MALFORMED, 1), (Outcome.UNAVAILABLE, 2), (Outcome.OTHER_MESSAGE, 3),
    ]  # fmt: skip


def test_the_minute_is_that_of_the_gateways_reception() -> None:
    an_hour_us = 3_600_000_000
    old = bundle(frame(1), received_us=RECEIVED_US - an_hour_us)
    now, before = (
        Codec(KEYS).decode([received(payload, GATEWAY, J2735_UPER)]).batch.t_us for payload in (frame(1), old)
    )
    assert now - before == [an_hour_us]


def test_batches_of_several_encodings_keep_their_order() -> None:
    station = encode_cam(cam(random.Random(1)))
    messages = [
        received(frame(1), "24ef0001", J2735_UPER),
        received(record("a"), "a", BSM_MSGPACK),
        received(station, GATEWAY, CAM_UPER),
        received(frame(2), "24EF0002", J2735_UPER),
        received(b"[", "a", J2735_RAW),
        received(record("b"), "b", BSM_MSGPACK),
        received(frame(3), "24EF0004", J2735_UPER),
        received(frame(3), "24EF0003", J2735_UPER, is_put=False),
    ]
    decoded = Codec(KEYS).decode(messages)
    assert decoded.sources.tolist() == [0, 1, 2, 3, 5]
    assert ids_of(decoded.batch.ids)[:2] == ["24EF0001", "a"]
    assert {one.reason.outcome for one in decoded.rejections} == {
        Outcome.MALFORMED, Outcome.IDENTITY_MISMATCH, Outcome.NOT_A_PUT,
    }  # fmt: skip
    assert Codec(KEYS).records_in(messages) >= len(messages) - 1


def test_a_message_of_a_slow_form_leaves_the_others_to_the_fast_one(monkeypatch: pytest.MonkeyPatch) -> None:
    codec = Codec(KEYS)
    fast = [received(record(name), name, BSM_MSGPACK) for name in "abc"]
    codec.decode(fast)
    examined: list[int] = []
    decode_any = codec._decode_any
    monkeypatch.setattr(codec, "_decode_any", lambda some: examined.append(len(some)) or decode_any(some))
    decoded = codec.decode([fast[0], received(b"{}", "d", BSM_JSON), fast[1], fast[2]])
    assert decoded.sources.tolist() == [0, 2, 3]
    assert ids_of(decoded.batch.ids) == ["a", "b", "c"]
    assert examined == [1]


@pytest.mark.parametrize("encoding", [J2735_ODE, J2735_RAW, CAM_JSON])
def test_one_frame_that_is_not_json_spoils_no_other(encoding: str) -> None:
    payload = bundle(b"{}", b"{", b"[{}, {}]", b"\xff")
    rejections = Codec(KEYS).decode([received(payload, GATEWAY, encoding)]).rejections
    assert sorted(one.reason.outcome for one in rejections) == [Outcome.MALFORMED] * 2 + [Outcome.OTHER_MESSAGE] * 3
    assert Codec(KEYS).records_in([received(payload, GATEWAY, encoding)]) == 5


@pytest.mark.parametrize("encoding", [J2735_UPER, CAM_UPER, J2735_ODE, CAM_JSON])
@pytest.mark.parametrize(
    ("payload", "outcome", "count"),
    [
        (bundle(*[frame(1)] * 20), Outcome.BUNDLE_TOO_LARGE, 20),
        (b"\x90", Outcome.MALFORMED, 1),
        (b"\x91\x01", Outcome.MALFORMED, 1),
        (b"\x91\x93\xc4\x01a\xff\xa0", Outcome.MALFORMED, 1),
        (b"\xdd\xff\xff\xff\xff", Outcome.MALFORMED, 1),
    ],
)
def test_what_is_no_bundle(payload: bytes, outcome: Outcome, count: int, encoding: str) -> None:
    (rejection,) = Codec(KEYS, bundle_max=10).decode([received(payload, GATEWAY, encoding)]).rejections
    assert (rejection.reason.outcome, rejection.count) == (outcome, count)


def test_a_vehicle_may_send_its_own_frames_only() -> None:
    codec = Codec(KEYS)
    assert len(codec.decode([received(frame(1), "24ef0001", J2735_UPER)]).batch) == 1
    (rejection,) = codec.decode([received(frame(1), "24ef0002", J2735_UPER)]).rejections
    assert rejection.reason.outcome is Outcome.IDENTITY_MISMATCH
