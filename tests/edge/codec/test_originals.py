"""One message out of any payload: the octets that came, or the record by itself."""

import json
import random

import msgpack
import pytest
from edge.codec.messages import KEYS, RECEIVED_US, as_map, received, record
from feeds.asn1_modules import encode_bsm, encode_cam
from feeds.made_messages import bsm_core, cam, si_of_cam
from feeds.test_cam_json import VANETZA
from feeds.test_j2735_json import ode, raw

from headway.edge.codec.decoder import Codec
from headway.edge.codec.originals import original_of
from headway_schemas.encodings import BSM_JSON, BSM_MSGPACK, CAM_JSON, CAM_UPER, J2735_ODE, J2735_RAW, J2735_UPER
from headway_schemas.frames import Frame, pack

AT_US = RECEIVED_US - 5_000
RNG = random.Random(1)
GOOD = {"secMark": 1, "lat": 423_000_001, "long": -837_000_002, "speed": 675}
BSMS = [encode_bsm(bsm_core(RNG) | GOOD) for _ in range(3)]
CAMS = [encode_cam(one) for one in (cam(RNG) for _ in range(30)) if isinstance(si_of_cam(one, RECEIVED_US), dict)][:3]
BROKEN = b"{"


def text(content: object) -> bytes:
    return json.dumps(content, indent=1).encode()


def bundle(*messages: bytes) -> bytes:
    return pack([Frame(message, AT_US, "10.0.0.7") for message in messages])


@pytest.mark.parametrize(
    ("encoding", "payload", "index", "expected"),
    [
        (BSM_MSGPACK, msgpack.packb(record("a")), 0, msgpack.packb(record("a"))),
        (BSM_MSGPACK, msgpack.packb([record("a"), record("b")]), 1, msgpack.packb(record("b"))),
        (BSM_MSGPACK, msgpack.packb([as_map(record("a"))]), 0, msgpack.packb(as_map(record("a")))),
        (BSM_JSON, text(record("a")), 0, text(record("a"))),
        (BSM_JSON, text([record("a"), record("b")]), 1, json.dumps(record("b")).encode()),
        (J2735_RAW, text(raw()), 0, text(raw())),
        (J2735_RAW, text([raw(), raw(msgCnt=9)]), 1, json.dumps(raw(msgCnt=9)).encode()),
        (J2735_ODE, text(ode()), 0, text(ode())),
        (J2735_ODE, bundle(text(ode()), BROKEN, text([ode(), ode(msgCnt=9)])), 3, text([ode(), ode(msgCnt=9)])),
        (J2735_ODE, bundle(text(ode()), BROKEN, text(ode(msgCnt=8))), 2, text(ode(msgCnt=8))),
        (CAM_JSON, bundle(text(VANETZA)), 0, text(VANETZA)),
        (J2735_UPER, BSMS[0], 0, BSMS[0]),
        (J2735_UPER, bundle(*BSMS), 2, BSMS[2]),
        (CAM_UPER, bundle(*CAMS), 1, CAMS[1]),
    ],
)
def test_the_message_of_a_record(encoding: str, payload: bytes, index: int, expected: bytes) -> None:
    original = original_of(payload, encoding, index, RECEIVED_US)
    is_framed = encoding not in (BSM_MSGPACK, BSM_JSON) and payload[0] in (0x91, 0x92, 0x93)
    assert original.payload == expected
    assert original.received_us == (AT_US if is_framed else RECEIVED_US)
    assert original.encoding == encoding


@pytest.mark.parametrize(
    ("encoding", "payload"),
    [
        (BSM_MSGPACK, msgpack.packb([record("a"), record("b", speed_mps=-1), record("c")])),
        (J2735_RAW, text([raw(), raw(speed=8191), raw(id="00000003")])),
        (J2735_ODE, bundle(text(ode()), BROKEN, text(ode(id="00000003")))),
        (J2735_UPER, bundle(BSMS[0], b"nothing", BSMS[2])),
        (CAM_UPER, bundle(CAMS[0], b"nothing", CAMS[2])),
    ],
)
def test_decoding_tells_the_place_of_each_record_in_its_payload(encoding: str, payload: bytes) -> None:
    """What is cut out by that place decodes to the same vehicle, also behind a record that is rejected."""
    codec, messages = Codec(KEYS), [received(payload, "gw-1", encoding), received(record("z"), "z")]
    codec.decode(messages[1:])
    decoded = codec.decode(messages)
    of_first = decoded.sources == 0
    assert [rejection.index for rejection in decoded.rejections if rejection.index is not None] == [1]
    assert decoded.indices[of_first].tolist() == [0, 2]
    assert decoded.indices[~of_first].tolist() == [0]
    for vehicle, index in zip(decoded.batch.ids[of_first], decoded.indices[of_first], strict=True):
        alone = original_of(payload, encoding, int(index), RECEIVED_US)
        again = codec.decode([received(alone.payload, "gw-1", encoding)])
        assert again.batch.ids.tolist() == [vehicle]
