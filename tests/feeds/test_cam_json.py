import math
import random
from typing import Any

import pytest
from feeds.made_messages import NOW_US, cam, si_of_cam

from headway.feeds.cam_json import from_cam
from headway.feeds.refusal import Refusal
from headway.feeds.uper import NAMES

BASIC = {"stationType": 5, "referencePosition": {
    "latitude": 40.6283493, "longitude": -8.6543904,
    "positionConfidenceEllipse": {"semiMajorAxisLength": 4095, "semiMinorAxisLength": 4095},
    "altitude": {"altitudeValue": 800001, "altitudeConfidence": 15},
}}  # fmt: skip
FAST = {
    "heading": {"headingValue": 153.0, "headingConfidence": 127},
    "speed": {"speedValue": 8.7, "speedConfidence": 127},
    "vehicleLength": {"vehicleLengthValue": 1023, "vehicleLengthConfidenceIndication": 4},
    "vehicleWidth": 62,
    "longitudinalAcceleration": {"value": -0.4, "confidence": 102},
}
DELTA = ((NOW_US - 1_072_915_200_000_000) // 1000 + 5000) % 65_536
VANETZA = {
    "timestamp": NOW_US / 1e6,
    "fields": {
        "header": {"protocolVersion": 2, "messageID": 2, "stationID": 99},
        "cam": {
            "generationDeltaTime": DELTA,
            "camParameters": {"basicContainer": BASIC, "highFrequencyContainer": {
                "basicVehicleContainerHighFrequency": FAST}},
        },
    },
}  # fmt: skip
ITS_CLIENT = {
    "message_type": "cam", "source_uuid": "u", "timestamp": NOW_US // 1000, "version": "1.1.3",
    "message": {
        "protocol_version": 1, "station_id": 99, "generation_delta_time": DELTA,
        "basic_container": {
            "station_type": 5,
            "reference_position": {"latitude": 406283493, "longitude": -86543904, "altitude": 800001},
            "confidence": {"position_confidence_ellipse": {"semi_major_confidence": 4095}},
        },
        "high_frequency_container": {
            "heading": 1530, "speed": 870, "vehicle_length": 1023, "vehicle_width": 62, "longitudinal_acceleration": -4,
        },
    },
}  # fmt: skip
EXPECTED = [1, "99", 0, NOW_US, 40.6283493, -8.6543904, 8.7, 153.0, None, -0.4, None, None, None]


@pytest.mark.parametrize(
    "message",
    [VANETZA, ITS_CLIENT, VANETZA["fields"], {"stationID": 99, **VANETZA["fields"]["cam"]}],  # type: ignore[index]
    ids=["vanetza-nap", "its-client", "without envelope", "as sent to vanetza-nap"],
)
def test_both_dialects_say_the_same(message: Any) -> None:
    assert from_cam(message, NOW_US) == EXPECTED


@pytest.mark.parametrize("age_us", [0, 3_600_000_000, 32_000_000])
def test_the_envelope_decides_the_period(age_us: int) -> None:
    assert from_cam(VANETZA, NOW_US + age_us) == EXPECTED
    assert from_cam(ITS_CLIENT, NOW_US + age_us) == EXPECTED


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (7, "malformed"),
        ({}, "other_message"),
        ({"metadata": {}, "payload": {"data": {"coreData": {"secMark": 1}}}}, "other_message"),
        ({"messageId": 20, "value": {}}, "other_message"),
        ({"type": "FeatureCollection", "features": []}, "other_message"),
        ({"message_type": "cpm", "message": {"station_id": 7}}, "other_message"),
        (ITS_CLIENT | {"timestamp": "noon"}, "unreadable_time"),
        (ITS_CLIENT | {"message": ITS_CLIENT["message"] | {"generation_delta_time": None}}, "unavailable"),  # type: ignore[operator]
        (ITS_CLIENT | {"message": ITS_CLIENT["message"] | {"generation_delta_time": 65_536}}, "out_of_range"),  # type: ignore[operator]
        (ITS_CLIENT | {"message": ITS_CLIENT["message"] | {"generation_delta_time": 1.5}}, "malformed"),  # type: ignore[operator]
    ],
)
def test_what_is_no_cam_is_named(message: Any, reason: str) -> None:
    refusal = from_cam(message, NOW_US)
    assert isinstance(refusal, Refusal)
    assert refusal.reason == reason


def test_json_says_what_uper_says() -> None:
    rng, compared = random.Random(3), 0
    for _ in range(500):
        message = cam(rng)
        parameters = message["cam"]["camParameters"]
        position, (_, vehicle) = parameters["basicContainer"]["referencePosition"], parameters["highFrequencyContainer"]
        as_json = {"header": message["header"], "cam": message["cam"] | {"camParameters": {
            "basicContainer": {"referencePosition": position | {
                "positionConfidenceEllipse": {"semiMajorConfidence": position["ellipse"]["semiMajor"]}}},
            "highFrequencyContainer": {"basicVehicleContainerHighFrequency": vehicle},
        }}}  # fmt: skip
        expected = si_of_cam(message, NOW_US)
        if isinstance(expected, str):
            continue
        compared += 1
        record = from_cam(as_json, NOW_US)
        assert isinstance(record, list)
        values = [math.nan if value is None else float(value) for value in record[2:]]
        assert values == pytest.approx([expected[name] for name in NAMES], nan_ok=True)
    assert compared > 50
