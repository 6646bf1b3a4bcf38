"""The forms of a message as systems write them, each decoded and each through the codec of the service.

A line is one message that says the same in its own way; the second table is generated from files, where they are.
"""

import json
from pathlib import Path
from typing import Any

import pytest
from edge.codec.messages import GATEWAY, KEYS, ids_of, received
from feeds.asn1_modules import encode_bsm
from feeds.test_j2735_json import NOON_US, ODE, RAW, SAME

from headway.edge.codec.decoder import Codec
from headway.feeds.instants import instant_us
from headway_schemas.bsm import to_map
from headway_schemas.encodings import BSM_JSON, J2735_ODE, J2735_RAW, J2735_UPER

RAW_CORE = RAW["value"]["BasicSafetyMessage"]["coreData"]
FRAME = encode_bsm(
    {
        "msgCnt": 95, "id": bytes.fromhex("24EF0000"), "secMark": 14_300, "lat": 423_000_001, "long": -837_000_002,
        "elev": 2600, "accuracy": {"semiMajor": 30, "semiMinor": 40, "orientation": 0}, "transmission": "forward",
        "speed": 675, "heading": 7200, "angle": 0, "accelSet": {"long": -50, "lat": 0, "vert": 0, "yaw": 0},
        "brakes": {"wheels": (b"\0", 5), "traction": "off", "abs": "off", "scs": "off", "boost": "off", "aux": "off"},
        "size": {"width": 190, "length": 460},
    }
)  # fmt: skip
TIME = {"odeReceivedAt": "2024-05-01T12:00:14.443 [UTC]"}
HUB = {"metadata": {"utctimestamp": "2024-05-01T12:00:14.4Z", "originRsu": "10.0.0.7"}}
FORMS: dict[str, tuple[Any, str]] = {
    "BSM v1": (to_map(SAME), BSM_JSON),
    "ODE, schema 6": (ODE, J2735_ODE),
    "ODE, schema 8, over UDP": (ODE | {"metadata": TIME | {"recordGeneratedAt": ""}}, J2735_ODE),
    "ODE, schema 9": ({"metadata": TIME, "payload": {"data": RAW}}, J2735_ODE),
    "ODE, hex": ({"metadata": TIME, "payload": {"data": {"bytes": FRAME.hex()}}}, J2735_ODE),
    "V2X-Hub, hex": ({"BsmMessageContent": [HUB | {"payload": FRAME.hex()}]}, J2735_RAW),
    "V2X-Hub, JSON": ({"BsmMessageContent": [HUB | {"bsm": {"coreData": RAW_CORE | {"id": 0x24EF0000}}}]}, J2735_RAW),
    "MessageFrame": ({"metadata": TIME, "data": {"MessageFrame": RAW}}, J2735_RAW),
    "pycrate": (
        {"metadata": TIME, "data": {"messageId": 20, "value": ["BasicSafetyMessage", {"coreData": RAW_CORE}]}},
        J2735_RAW,
    ),
    "id as integers": ({"metadata": TIME, "data": {"coreData": RAW_CORE | {"id": [36, 239, 0, 0]}}}, J2735_RAW),
    "id in small letters": ({"metadata": TIME, "data": {"coreData": RAW_CORE | {"id": "24 ef 00 00"}}}, J2735_RAW),
}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("bundled", [False, True], ids=["one", "in a bundle"])
def test_each_form_says_the_same_through_the_service(form: str, bundled: bool) -> None:
    message, encoding = FORMS[form]
    decoded = Codec(KEYS).decode([received([message] * 3 if bundled else message, GATEWAY, encoding)])
    assert decoded.rejections == []
    assert ids_of(decoded.batch.ids) == [SAME.id] * len(decoded.batch)
    batch = decoded.batch
    for column, value in (
        (batch.t_us, NOON_US + 14_300_000), (batch.lat_deg, SAME.lat), (batch.lon_deg, SAME.lon),
        (batch.speed_mps, SAME.speed_mps), (batch.heading_deg, SAME.heading_deg), (batch.accel_mps2, SAME.accel_mps2),
        (batch.accuracy_m, SAME.accuracy_m), (batch.length_m, SAME.length_m),
    ):  # fmt: skip
        assert column.tolist() == pytest.approx([value] * len(column))


def test_uper_says_the_same() -> None:
    decoded = Codec(KEYS).decode(
        [received(FRAME, "24ef0000", J2735_UPER)], NOON_US + 15_000_000 - 1_700_000_000_000_000
    )
    assert ids_of(decoded.batch.ids) == [SAME.id]
    assert decoded.batch.t_us.tolist() == [NOON_US + 14_300_000]
    assert decoded.batch.lat_deg.tolist() == [SAME.lat]


@pytest.fixture(scope="session")
def cases(shared_data: Path) -> Path:
    """Folder of files as other systems write them."""
    folder = shared_data.parent / "cases" / "other"
    if not folder.is_dir():
        pytest.skip(f"files of other systems not found at {folder}")
    return folder


def test_files_of_ode_say_their_own_numbers(cases: Path) -> None:
    files = [file for file in cases.glob("*.json") if b'"coreData"' in file.read_bytes()]
    assert files
    for file in files:
        message = json.loads(file.read_text(encoding="utf-8"))
        core = message["payload"]["data"]["coreData"]
        decoded = Codec(KEYS).decode([received(message, GATEWAY, J2735_ODE)])
        assert decoded.rejections == []
        assert ids_of(decoded.batch.ids) == [core["id"].upper()]
        assert decoded.batch.lat_deg.tolist() == [core["position"]["latitude"]]
        assert decoded.batch.speed_mps.tolist() == [core["speed"]]
        generated_us = instant_us(message["metadata"]["recordGeneratedAt"])
        assert generated_us is not None
        assert abs(decoded.batch.t_us[0] - generated_us) < 30_000_000
        assert decoded.batch.t_us[0] // 1000 % 60_000 == core["secMark"]
