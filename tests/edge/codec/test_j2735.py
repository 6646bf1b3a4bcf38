import copy
from datetime import UTC, datetime
from typing import Any

import pytest
from edge.codec.messages import GATEWAY, KEYS, ids_of, received

from headway.core.types.outcome import Outcome
from headway.edge.codec import j2735
from headway.edge.codec.decoder import Codec
from headway.edge.transport.message import RejectReason
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


def bsm_of(result: list[Any] | RejectReason) -> Bsm:
    assert not isinstance(result, RejectReason), result
    return from_record(result)


def reason_of(message: Any, encoding: str) -> Outcome:
    (rejection,) = Codec(KEYS).decode([received(message, "24EF0000", encoding)]).rejections
    return rejection.reason.outcome


def test_both_profiles_say_the_same_in_si_units() -> None:
    assert bsm_of(j2735.from_raw(RAW, NOON_US + 15_000_000)) == SAME
    assert bsm_of(j2735.from_ode(ODE, 0)) == SAME


def test_a_message_needs_no_wrapper() -> None:
    for bare in (core_of(RAW), {"coreData": core_of(RAW)}, RAW["value"], {"payload": {"data": RAW}}):
        assert bsm_of(j2735.from_raw(bare, NOON_US + 15_000_000)) == SAME


def test_the_extreme_values_of_raw_are_within_the_ranges() -> None:
    low = raw(
        lat=-900000000, long=-1799999999, speed=0, heading=0, elev=-4095, secMark=0, msgCnt=0,
        accelSet={"long": -2000}, accuracy={"semiMajor": 0}, size={"width": 1, "length": 1},
    )  # fmt: skip
    high = raw(
        lat=900000000, long=1800000000, speed=8190, heading=28799, elev=61439, secMark=60999, msgCnt=127,
        accelSet={"long": 2000}, accuracy={"semiMajor": 254}, size={"width": 1023, "length": 4095},
    )  # fmt: skip
    assert bsm_of(j2735.from_raw(low, NOON_US)).accel_mps2 == -20.0
    assert bsm_of(j2735.from_raw(high, NOON_US)).speed_mps == 163.8


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
    assert bsm_of(j2735.from_raw(raw(**changes), NOON_US + 15_000_000)) == SAME.model_copy(update={field: None})


@pytest.mark.parametrize("accel", [2001, 2001.0, None])
def test_an_unavailable_acceleration_of_ode_is_null(accel: object) -> None:
    message = ode(accelSet={"accelLong": accel})
    assert bsm_of(j2735.from_ode(message, 0)) == SAME.model_copy(update={"accel_mps2": None})


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
        (raw(speed=True), J2735_RAW, Outcome.MALFORMED),
        (raw(size={"length": "460"}), J2735_RAW, Outcome.MALFORMED),
        (raw(secMark=14.3), J2735_RAW, Outcome.MALFORMED),
        (raw(secMark=True), J2735_RAW, Outcome.MALFORMED),
        (raw(id="24 EF"), J2735_RAW, Outcome.MALFORMED),
        (raw(id="24EF0001"), J2735_RAW, Outcome.IDENTITY_MISMATCH),
        (ode(speed=None), J2735_ODE, Outcome.UNAVAILABLE),
        (ode(secMark=None), J2735_ODE, Outcome.UNAVAILABLE),
        (ode(position={"latitude": 42.3}), J2735_ODE, Outcome.UNAVAILABLE),
        (ode(position=7), J2735_ODE, Outcome.UNAVAILABLE),
        (ode(accelSet={"accelLong": 20.01}), J2735_ODE, Outcome.OUT_OF_RANGE),
        (ode(speed=True), J2735_ODE, Outcome.MALFORMED),
        (7, J2735_RAW, Outcome.MALFORMED),
        ({"value": []}, J2735_ODE, Outcome.MALFORMED),
        ({}, J2735_RAW, Outcome.UNAVAILABLE),
    ],
)
def test_bad_messages_are_named(message: Any, encoding: str, reason: Outcome) -> None:
    assert reason_of(message, encoding) is reason


def test_raw_is_never_taken_for_ode_nor_ode_for_raw() -> None:
    assert reason_of(RAW, J2735_ODE) is Outcome.UNAVAILABLE
    assert reason_of(ODE, J2735_RAW) is Outcome.MALFORMED


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
    assert bsm_of(j2735.from_raw(raw(secMark=sec_mark), received_us)).t_us == t_us


@pytest.mark.parametrize("generated_at", [None, 7, "yesterday", "2024-05-01T12:00:14.350"])
def test_ode_without_a_generation_time_goes_by_receipt(generated_at: object) -> None:
    message = ode() | {"metadata": {"recordGeneratedAt": generated_at}}
    assert bsm_of(j2735.from_ode(message, NOON_US + 14_500_000)) == SAME
    assert bsm_of(j2735.from_ode(message | {"metadata": None}, NOON_US + 14_500_000)) == SAME


def test_a_bundle_of_j2735_messages() -> None:
    decoded = Codec(KEYS).decode([received([raw(), raw(id="A"), raw(speed=8191)], GATEWAY, J2735_RAW)])
    assert ids_of(decoded.batch.ids) == ["24EF0000", "A"]
    assert [(rejection.reason.outcome, rejection.index) for rejection in decoded.rejections] == [
        (Outcome.UNAVAILABLE, 2)
    ]
