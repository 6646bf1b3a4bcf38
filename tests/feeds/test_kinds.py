"""A message under the encoding of another is named as what it is, never as a record without values."""

import json
from random import Random
from typing import Any

import pytest
from edge.codec.messages import GATEWAY, KEYS, RECEIVED_US, as_map, record
from feeds.asn1_modules import encode_bsm, encode_cam
from feeds.made_messages import bsm_core, cam
from feeds.test_cam_json import ITS_CLIENT, VANETZA
from feeds.test_j2735_json import ode, raw

from headway.core.types.outcome import Outcome
from headway.edge.codec.decoder import Codec
from headway.edge.transport.message import ReceivedMessage
from headway_schemas import encodings as e

BSM_V1 = "a record of BSM v1"
J2735 = "a basic safety message: the encodings of J2735 read it"
CAM = "a CAM: the encoding application/json;cam reads it"
GEOJSON = {"type": "FeatureCollection", "features": []}
TIM = {"metadata": {}, "payload": {"data": {"messageId": 31, "value": {}}}}
DENM = {"header": {"messageID": 1, "stationID": 5}, "denm": {}}
BSM_UPER, CAM_UPER = encode_bsm(bsm_core(Random(1))), encode_cam(cam(Random(1)))


def outcome_of(payload: bytes, encoding: str) -> tuple[Outcome, str]:
    message = ReceivedMessage(KEYS.bsm(GATEWAY), payload, encoding, True, RECEIVED_US, 0)
    (rejection,) = Codec(KEYS).decode([message]).rejections
    return rejection.reason.outcome, rejection.reason.detail


@pytest.mark.parametrize("encoding", [e.J2735_RAW, e.J2735_ODE, e.CAM_JSON, e.BSM_JSON])
@pytest.mark.parametrize(
    ("message", "words", "of"),
    [
        (GEOJSON, "GeoJSON", ()),
        (TIM, "a TravelerInformation", ()),
        (DENM, "a message of type denm", ()),
        (as_map(record()), BSM_V1, (e.BSM_JSON,)),
        (raw(), J2735, (e.J2735_RAW, e.J2735_ODE)),
        (ode(), J2735, (e.J2735_RAW, e.J2735_ODE)),
        (VANETZA, CAM, (e.CAM_JSON,)),
        (ITS_CLIENT, CAM, (e.CAM_JSON,)),
    ],
)
def test_json_of_another_encoding_is_named(message: Any, words: str, of: tuple[str, ...], encoding: str) -> None:
    if encoding in of:
        return
    outcome, detail = outcome_of(json.dumps(message).encode(), encoding)
    assert outcome is Outcome.OTHER_MESSAGE
    assert detail.startswith(words)


@pytest.mark.parametrize(
    ("payload", "encoding", "outcome", "words"),
    [
        (CAM_UPER, e.J2735_UPER, Outcome.OTHER_MESSAGE, "a CAM: the encoding application/cam;uper"),
        (CAM_UPER.hex().encode(), e.J2735_UPER, Outcome.OTHER_MESSAGE, "a CAM: the encoding application/cam;uper"),
        (bytes([2, 1]) + bytes(60), e.J2735_UPER, Outcome.OTHER_MESSAGE, "a DENM"),
        (BSM_UPER, e.CAM_UPER, Outcome.OTHER_MESSAGE, "a BasicSafetyMessage: the encoding application/j2735;uper"),
        (json.dumps(ode()).encode(), e.J2735_UPER, Outcome.MALFORMED, "JSON, neither octets"),
        (json.dumps(VANETZA).encode(), e.CAM_UPER, Outcome.MALFORMED, "JSON, neither octets"),
        (b"\xff" * 60, e.J2735_UPER, Outcome.MALFORMED, "no message found"),
    ],
)
def test_octets_of_another_encoding_are_named(payload: bytes, encoding: str, outcome: Outcome, words: str) -> None:
    found, detail = outcome_of(payload, encoding)
    assert found is outcome
    assert detail.startswith(words)
