import copy
from datetime import UTC, datetime
from typing import Any

import pytest
from edge.codec.messages import GATEWAY, KEYS, ids_of, received

from headway.core.types.outcome import Outcome
from headway.edge.codec.decoder import Codec
from headway.feeds import j2735_json
from headway.feeds.refusal import UNREADABLE_TIME, Refusal
from headway_schemas.bsm import Bsm, from_record
from headway_schemas.encodings import J2735_ODE, J2735_RAW

MINUTE_US = 60_000_000
NOON_US = round(datetime(2024, 5, 1, 12, 0, tzinfo=UTC).timestamp() * 1e6)

RAW: dict[str, Any] = {
    "messageId": 20,
    "value": {
        "BasicSafetyMessage": {
            "coreData": {
                "msgCnt": 95,
                "id": "24EF0000",
                "secMark": 14300,
                "lat": 423000001,
                "long": -837000002,
                "elev": 2600,
                "accuracy": {"semiMajor": 30, "semiMinor": 40, "orientation": 0},
                "transmission": "forwardGears",
                "speed": 675,
                "heading": 7200,
                "angle": 0,
                "accelSet": {"long": -50, "lat": 0, "vert": 0, "yaw": 0},
                "brakes": {},
                "size": {"width": 190, "length": 460},
            }
        }
    },
}
ODE: dict[str, Any] = {
    "metadata": {"recordGeneratedAt": "2024-05-01T12:00:14.350Z[UTC]", "schemaVersion": 6},
    "payload": {
        "data": {
            "coreData": {
                "msgCnt": 95,
                "id": "24EF0000",
                "secMark": 14300,
                "position": {"latitude": 42.3000001, "longitude": -83.7000002, "elevation": 260.0},
                "accelSet": {"accelLong": -0.5, "accelYaw": 0},
                "accuracy": {"semiMajor": 1.5, "semiMinor": 2.0},
                "speed": 13.5,
                "heading": 90,
                "size": {"width": 190, "length": 460},
            },
            "partII": [],
        }
    },
}
SAME = Bsm(
    v=1,
    id="24EF0000",
    msg_cnt=95,
    t_us=NOON_US + 14_300_000,
    lat=42.3000001,
    lon=-83.7000002,
    speed_mps=13.5,
    heading_deg=90.0,
    elev_m=260.0,
    accel_mps2=-0.5,
    accuracy_m=1.5,
    length_m=4.6,
    width_m=1.9,
)


def core_of(message: dict[str, Any]) -> dict[str, Any]:
    data: dict[str, Any] = message.get("payload", message).get("data", message)
    core: dict[str, Any] = (data if "coreData" in data else data["value"]["BasicSafetyMessage"])["coreData"]
    return core


def raw(**changes: Any) -> dict[str, Any]:
    message = copy.deepcopy(RAW)
    core_of(message).update(changes)
    return message


def ode(**changes: Any) -> dict[str, Any]:
    message = copy.deepcopy(ODE)
    core_of(message).update(changes)
    return message


def bsm_of(result: list[Any] | Refusal) -> Bsm:
    assert not isinstance(result, Refusal), result
    return from_record(result)


def reason_of(message: Any, encoding: str) -> Outcome:
    (rejection,) = Codec(KEYS).decode([received(message, "24EF0000", encoding)]).rejections
    return rejection.reason.outcome


def test_both_profiles_say_the_same_in_si_units() -> None:
    assert bsm_of(j2735_json.from_raw(RAW, NOON_US + 15_000_000)) == SAME
    assert bsm_of(j2735_json.from_ode(ODE, 0)) == SAME


def test_a_message_needs_no_wrapper() -> None:
    for bare in (core_of(RAW), {"coreData": core_of(RAW)}, RAW["value"], {"payload": {"data": RAW}}):
        assert bsm_of(j2735_json.from_raw(bare, NOON_US + 15_000_000)) == SAME


def test_the_extreme_values_of_raw_are_within_the_ranges() -> None:
    low = raw(
        lat=-900000000, long=-1799999999, speed=0, heading=0, elev=-4095, secMark=0, msgCnt=0,
        accelSet={"long": -2000}, accuracy={"semiMajor": 0}, size={"width": 1, "length": 1},
    )  # fmt: skip
    high = raw(
        lat=900000000, long=1800000000, speed=8190, heading=28799, elev=61439, secMark=60999, msgCnt=127,
        accelSet={"long": 2000}, accuracy={"semiMajor": 254}, size={"width": 1023, "length": 4095},
    )  # fmt: skip
    assert bsm_of(j2735_json.from_raw(low, NOON_US)).accel_mps2 == -20.0
    assert bsm_of(j2735_json.from_raw(high, NOON_US)).speed_mps == 163.8


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"heading": 28800}, "heading_deg"),
        ({"elev": -4096}, "elev_m"),
        ({"accelSet": {"long": 2001}}, "accel_mps2"),
        ({"accuracy": {"semiMajor": 255}}, "accuracy_m"),
        ({"size": {"width": 0, "length": 460}}, "width_m"),
        ({"size": {"width": 190, "length": 0}}, "length_m"),
        ({"size": {"width": 190}}, "length_m"),
        ({"accuracy": None}, "accuracy_m"),
    ],
)
def test_a_sentinel_of_raw_is_null(changes: dict[str, Any], field: str) -> None:
    assert bsm_of(j2735_json.from_raw(raw(**changes), NOON_US + 15_000_000)) == SAME.model_copy(update={field: None})


@pytest.mark.parametrize("accel", [2001, 2001.0, None])
def test_an_unavailable_acceleration_of_ode_is_null(accel: object) -> None:
    message = ode(accelSet={"accelLong": accel})
    assert bsm_of(j2735_json.from_ode(message, 0)) == SAME.model_copy(update={"accel_mps2": None})


@pytest.mark.parametrize(
    ("message", "encoding", "reason"),
    [
        (raw(speed=8191), J2735_RAW, Outcome.UNAVAILABLE),
        (raw(lat=900000001), J2735_RAW, Outcome.UNAVAILABLE),
        (raw(long=1800000001), J2735_RAW, Outcome.UNAVAILABLE),
        (raw(secMark=65535), J2735_RAW, Outcome.UNAVAILABLE),
        (raw(secMark=None), J2735_RAW, Outcome.UNAVAILABLE),
        (raw(secMark=61000), J2735_RAW, Outcome.OUT_OF_RANGE),
        (raw(secMark=-1), J2735_RAW, Outcome.OUT_OF_RANGE),
        (raw(speed=8192), J2735_RAW, Outcome.OUT_OF_RANGE),
        (raw(heading=28801), J2735_RAW, Outcome.OUT_OF_RANGE),
        (raw(accelSet={"long": 2002}), J2735_RAW, Outcome.OUT_OF_RANGE),
        (raw(msgCnt=128), J2735_RAW, Outcome.OUT_OF_RANGE),
        (raw(lat=10**400), J2735_RAW, Outcome.OUT_OF_RANGE),
        (raw(speed=13.5), J2735_RAW, Outcome.MALFORMED),
        (raw(speed="13.5"), J2735_RAW, Outcome.MALFORMED),
        (raw(speed=True), J2735_RAW, Outcome.MALFORMED),
        (raw(size={"length": "long"}), J2735_RAW, Outcome.MALFORMED),
        (raw(secMark=14.3), J2735_RAW, Outcome.MALFORMED),
        (raw(secMark=True), J2735_RAW, Outcome.MALFORMED),
        (raw(id="24 EF"), J2735_RAW, Outcome.IDENTITY_MISMATCH),
        (raw(id=""), J2735_RAW, Outcome.MALFORMED),
        (raw(id=None), J2735_RAW, Outcome.UNAVAILABLE),
        (raw(id="24EF0001"), J2735_RAW, Outcome.IDENTITY_MISMATCH),
        (ode(speed=None), J2735_ODE, Outcome.UNAVAILABLE),
        (ode(secMark=None), J2735_ODE, Outcome.UNAVAILABLE),
        (ode(position={"latitude": 42.3}), J2735_ODE, Outcome.UNAVAILABLE),
        (ode(position=7), J2735_ODE, Outcome.UNAVAILABLE),
        (ode(accelSet={"accelLong": 20.01}), J2735_ODE, Outcome.OUT_OF_RANGE),
        (ode(speed=True), J2735_ODE, Outcome.MALFORMED),
        (7, J2735_RAW, Outcome.MALFORMED),
        ({"value": []}, J2735_ODE, Outcome.OTHER_MESSAGE),
        ({"value": 7}, J2735_ODE, Outcome.MALFORMED),
        ({"coreData": {"secMark": 14300}}, J2735_RAW, Outcome.UNAVAILABLE),
    ],
)
def test_bad_messages_are_named(message: Any, encoding: str, reason: Outcome) -> None:
    assert reason_of(message, encoding) is reason


def test_integers_and_si_units_are_never_confused() -> None:
    assert reason_of({"coreData": core_of(RAW)}, J2735_ODE) is Outcome.OTHER_MESSAGE
    assert reason_of(ODE, J2735_RAW) is Outcome.OTHER_MESSAGE


@pytest.mark.parametrize(
    "data",
    [
        RAW,
        {"MessageFrame": RAW},
        {"messageId": "20", "value": RAW["value"]},
        {"messageId": 20, "value": ["BasicSafetyMessage", RAW["value"]["BasicSafetyMessage"]]},
    ],
    ids=["JER", "MessageFrame", "text", "pycrate"],
)
def test_a_message_frame_has_integers_in_either_profile(data: dict[str, Any]) -> None:
    schema_9 = {"metadata": ODE["metadata"] | {"schemaVersion": 9}, "payload": {"data": data}}
    assert bsm_of(j2735_json.from_ode(schema_9, 0)) == SAME
    assert bsm_of(j2735_json.from_raw(schema_9, 0)) == SAME


def test_numbers_may_be_text() -> None:
    def as_text(value: Any) -> Any:
        if isinstance(value, dict):
            return {name: as_text(inner) for name, inner in value.items()}
        return str(value)

    assert bsm_of(j2735_json.from_raw(as_text(RAW), NOON_US + 15_000_000)) == SAME
    assert bsm_of(j2735_json.from_ode(as_text(ODE), 0)) == SAME


@pytest.mark.parametrize("encoding", [J2735_RAW, J2735_ODE])
@pytest.mark.parametrize(
    ("message", "named"),
    [
        ({"messageId": 31, "value": {"TravelerInformation": {}}}, "a TravelerInformation"),
        ({"payload": {"data": {"MessageFrame": {"messageId": 19, "value": {"SPAT": {}}}}}}, "a SPAT"),
        ({"PersonalSafetyMessage": {"secMark": 1}}, None),
        ({"value": ["SPAT", {}]}, "a list that is no BasicSafetyMessage"),
        ({"type": "Feature", "geometry": {"type": "Point", "coordinates": [0, 0]}}, "GeoJSON"),
        ({"header": {"messageID": 2}, "cam": {"generationDeltaTime": 7}}, "a CAM"),
        ({"message_type": "cam", "message": {"station_id": 1}}, "a CAM"),
        ({"message_type": "denm", "message": {}}, "a message of type denm"),
        ({"v": 1, "id": "a", "t_us": 1, "speed_mps": 1.0}, "a record of BSM v1"),
        ({"metadata": {}, "payload": {"data": {"intersectionStateList": []}}}, "no basic safety message"),
        ({}, "no basic safety message"),
    ],
)
def test_another_message_is_named(message: Any, named: str | None, encoding: str) -> None:
    (rejection,) = Codec(KEYS).decode([received(message, GATEWAY, encoding)]).rejections
    if named is not None:
        assert rejection.reason.outcome is Outcome.OTHER_MESSAGE
        assert rejection.reason.detail.startswith(named)


@pytest.mark.parametrize(
    ("received_us", "sec_mark", "t_us"),
    [
        (NOON_US + 1_000_000, 900, NOON_US + 900_000),
        (NOON_US + 100_000, 59_900, NOON_US - 100_000),
        (NOON_US - 100_000, 50, NOON_US + 50_000),
        (NOON_US + 500_000, 60_400, NOON_US + 400_000),
        (NOON_US, 30_000, NOON_US - MINUTE_US // 2),
    ],
    ids=["same minute", "minute before", "minute after", "leap second", "half a minute"],
)
def test_the_minute_is_the_one_nearest_to_receipt(received_us: int, sec_mark: int, t_us: int) -> None:
    assert bsm_of(j2735_json.from_raw(raw(secMark=sec_mark), received_us)).t_us == t_us


@pytest.mark.parametrize("profile", [(RAW, j2735_json.from_raw), (ODE, j2735_json.from_ode)], ids=["raw", "ode"])
@pytest.mark.parametrize(
    ("metadata", "t_us"),
    [
        ({"recordGeneratedAt": "2024-05-01T12:00:14.350Z", "odeReceivedAt": "2024-05-01T13:00:00Z"}, NOON_US),
        ({"recordGeneratedAt": "", "odeReceivedAt": "2024-05-01T12:00:15.1Z[UTC]"}, NOON_US),
        ({"recordGeneratedAt": None, "odeReceivedAt": "2024-05-01T06:00:14-06:00[America/Denver]"}, NOON_US),
        ({"odeReceivedAt": "2024-05-01T08:00:14.443 [ET]"}, NOON_US),
        ({"utctimestamp": "2024-05-01T11:59:50.1Z"}, NOON_US),
        ({"odeReceivedAt": "2024-05-01T11:00:14Z"}, NOON_US - 60 * MINUTE_US),
        ({}, NOON_US + 60 * MINUTE_US),
        (None, NOON_US + 60 * MINUTE_US),
    ],
)
def test_the_envelope_decides_the_minute(profile: Any, metadata: Any, t_us: int) -> None:
    message, convert = profile
    received_us = NOON_US + 60 * MINUTE_US + 14_500_000
    result = convert(
        {"metadata": metadata, "payload": {"data": message.get("payload", {"data": message})["data"]}}, received_us
    )
    assert bsm_of(result).t_us == t_us + 14_300_000


@pytest.mark.parametrize("text", [7, "yesterday", "2024-05-01T12:00:14.350", "2024-05-01T12:00:14 [Atlantis]", True])
@pytest.mark.parametrize("name", ["recordGeneratedAt", "odeReceivedAt"])
def test_an_unreadable_time_is_named(name: str, text: object) -> None:
    for message, convert in ((RAW, j2735_json.from_raw), (ODE, j2735_json.from_ode)):
        result = convert(message | {"metadata": {name: text}}, NOON_US)
        assert isinstance(result, Refusal)
        assert result == Refusal(UNREADABLE_TIME, f"{name} is no time with a zone")


def test_odes_own_example() -> None:
    message = ode(secMark=2800) | {"metadata": {"recordGeneratedAt": "", "odeReceivedAt": "2024-08-12T12:32:03.811Z"}}
    expected = round(datetime(2024, 8, 12, 12, 32, 2, 800_000, tzinfo=UTC).timestamp() * 1e6)
    assert {bsm_of(j2735_json.from_ode(message, at_us)).t_us for at_us in (0, NOON_US, 2 * NOON_US)} == {expected}


def test_a_backlog_is_too_old() -> None:
    """Messages of an hour ago, with every millisecond of their minute, are all an hour old."""
    messages = [
        ode(secMark=mark, msgCnt=mark % 128)
        | {"metadata": {"odeReceivedAt": f"2024-05-01T11:00:{mark // 1000:02d}.9Z"}}
        for mark in range(0, 60_000, 10)
    ]
    for start in range(0, len(messages), 500):
        bundle = received(messages[start : start + 500], GATEWAY, J2735_ODE)
        decoded = Codec(KEYS, payload_max_bytes=10**6).decode([bundle])
        assert decoded.rejections == []
        ages_s = (NOON_US - 3_600_000_000 - decoded.batch.t_us) / 1e6
        assert ages_s.min() > -60.0
        assert ages_s.max() <= 0.0


def test_uper_within_json() -> None:
    octets = "00142B" + "00" * 43
    for wrapped in (
        {"metadata": {}, "payload": {"dataType": "OdeHexByteArray", "data": {"bytes": octets}}},
        {"BsmMessageContent": [{"metadata": {"utctimestamp": "2024-05-01T12:00:14Z"}, "payload": octets}]},
    ):
        (message,) = j2735_json.messages_in(wrapped)
        result = j2735_json.from_ode(message, NOON_US)
        assert not isinstance(result, Refusal)
        assert result[4:6] == [-90.0, -179.9999999]


def test_a_bundle_of_j2735_messages() -> None:
    decoded = Codec(KEYS).decode([received([raw(), raw(id="A"), raw(speed=8191)], GATEWAY, J2735_RAW)])
    assert ids_of(decoded.batch.ids) == ["24EF0000", "A"]
    assert [(rejection.reason.outcome, rejection.index) for rejection in decoded.rejections] == [
        (Outcome.UNAVAILABLE, 2)
    ]
