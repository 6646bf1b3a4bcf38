"""Random messages of the oracle, and what they say in SI units."""

import math
import random
from typing import Any

FOUR = ("unavailable", "off", "on", "engaged")
MINUTE_US = 60_000_000
NOW_US = 1_714_564_814_000_000
ITS_EPOCH_US = 1_072_915_200_000_000


def bsm_core(rng: random.Random) -> dict[str, Any]:
    """Return core data, each number anywhere in its range, at its ends more often."""

    def number(low: int, high: int) -> int:
        return rng.choice([low, high, rng.randint(low, high), rng.randint(low, high)])

    return {
        "msgCnt": number(0, 127),
        "id": rng.randbytes(4),
        "secMark": number(0, 65535),
        "lat": number(-900_000_000, 900_000_001),
        "long": number(-1_799_999_999, 1_800_000_001),
        "elev": number(-4096, 61_439),
        "accuracy": {"semiMajor": number(0, 255), "semiMinor": number(0, 255), "orientation": number(0, 65535)},
        "transmission": rng.choice(["neutral", "park", "forward", "reverse", "unavailable"]),
        "speed": number(0, 8191),
        "heading": number(0, 28_800),
        "angle": number(-126, 127),
        "accelSet": {
            "long": number(-2000, 2001), "lat": number(-2000, 2001), "vert": number(-127, 127),
            "yaw": number(-32767, 32767),
        },
        "brakes": {
            "wheels": (bytes([rng.randrange(32) << 3]), 5), "traction": rng.choice(FOUR), "abs": rng.choice(FOUR),
            "scs": rng.choice(FOUR), "boost": rng.choice(FOUR[:3]), "aux": rng.choice(FOUR),
        },
        "size": {"width": number(0, 1023), "length": number(0, 4095)},
    }  # fmt: skip


def part_ii(rng: random.Random) -> list[dict[str, Any]]:
    """Return some content that is skipped."""
    return [{"id": rng.randrange(64), "content": rng.randbytes(rng.randrange(40))} for _ in range(rng.randrange(5))]


def si_of_core(core: dict[str, Any], reference_us: int) -> dict[str, float] | str:
    """Return the numbers of a record, or the reason why there is none: written from V2X.md, not from the decoder."""
    if core["secMark"] == 65535 or core["lat"] == 900_000_001 or core["long"] == 1_800_000_001 or core["speed"] == 8191:
        reserved = 61_000 <= core["secMark"] < 65_535
        return "out_of_range" if reserved else "unavailable"
    if core["secMark"] > 60_999:
        return "out_of_range"
    candidates = [
        reference_us // MINUTE_US * MINUTE_US + n * MINUTE_US + core["secMark"] * 1000 for n in (-2, -1, 0, 1)
    ]

    def si(value: int, unit: float, unavailable: int) -> float:
        return math.nan if value == unavailable else value * unit

    return {
        "msg_cnt": core["msgCnt"],
        "t_us": min(candidates, key=lambda t_us: abs(t_us - reference_us)),
        "lat": core["lat"] * 1e-7,
        "lon": core["long"] * 1e-7,
        "speed_mps": core["speed"] * 0.02,
        "heading_deg": si(core["heading"], 0.0125, 28_800),
        "elev_m": si(core["elev"], 0.1, -4096),
        "accel_mps2": si(core["accelSet"]["long"], 0.01, 2001),
        "accuracy_m": si(core["accuracy"]["semiMajor"], 0.05, 255),
        "length_m": si(core["size"]["length"], 0.01, 0),
        "width_m": si(core["size"]["width"], 0.01, 0),
    }


def cam(rng: random.Random) -> dict[str, Any]:
    """Return a CAM of a vehicle."""

    def number(low: int, high: int) -> int:
        return rng.choice([low, high, rng.randint(low, high), rng.randint(low, high)])

    vehicle = {
        "heading": {"value": number(0, 3601), "confidence": number(1, 127)},
        "speed": {"value": number(0, 16_383), "confidence": number(1, 127)},
        "driveDirection": rng.choice(["forward", "backward", "unavailable"]),
        "vehicleLength": {"value": number(1, 1023), "confidence": number(0, 4)},
        "vehicleWidth": number(1, 62),
        "longitudinalAcceleration": {"value": number(-160, 161), "confidence": number(0, 102)},
        "curvature": {"value": number(-1023, 1023), "confidence": number(0, 7)},
        "curvatureCalculationMode": "yawRateUsed",
        "yawRate": {"value": number(-32766, 32767), "confidence": number(0, 8)},
    }
    if rng.random() < 0.5:
        vehicle["performanceClass"] = 3
        vehicle["lanePosition"] = 2
    parameters = {
        "basicContainer": {
            "stationType": 5,
            "referencePosition": {
                "latitude": number(-900_000_000, 900_000_001),
                "longitude": number(-1_800_000_000, 1_800_000_001),
                "ellipse": {"semiMajor": number(0, 4095), "semiMinor": 7, "orientation": 8},
                "altitude": {"value": number(-100_000, 800_001), "confidence": 3},
            },
        },
        "highFrequencyContainer": ("vehicle", vehicle),
    }
    if rng.random() < 0.5:
        parameters["lowFrequencyContainer"] = rng.randbytes(20)
    return {
        "header": {"protocolVersion": 2, "messageID": 2, "stationID": number(0, 2**32 - 1)},
        "cam": {"generationDeltaTime": number(0, 65_535), "camParameters": parameters},
    }


def si_of_cam(message: dict[str, Any], reference_us: int) -> dict[str, float] | str:
    """Return the numbers of a record, or the reason why there is none."""
    parameters = message["cam"]["camParameters"]
    position, (_, vehicle) = parameters["basicContainer"]["referencePosition"], parameters["highFrequencyContainer"]
    speed = vehicle["speed"]["value"]
    if position["latitude"] == 900_000_001 or position["longitude"] == 1_800_000_001 or speed == 16_383:
        return "out_of_range" if speed in (16_381, 16_382) else "unavailable"
    if speed > 16_380:
        return "out_of_range"
    its_ms = (reference_us - ITS_EPOCH_US) // 1000 + 5000
    candidates = [
        its_ms // 65_536 * 65_536 + n * 65_536 + message["cam"]["generationDeltaTime"] for n in (-2, -1, 0, 1)
    ]
    nearest = min(candidates, key=lambda ms: abs(ms - its_ms))

    def si(value: int, unit: float, unavailable: int) -> float:
        return math.nan if value == unavailable else value * unit

    length = si(vehicle["vehicleLength"]["value"], 0.1, 1023)
    altitude = si(position["altitude"]["value"], 0.01, 800_001)
    return {
        "msg_cnt": 0,
        "t_us": ITS_EPOCH_US + (nearest - 5000) * 1000,
        "lat": position["latitude"] * 1e-7,
        "lon": position["longitude"] * 1e-7,
        "speed_mps": speed * 0.01,
        "heading_deg": si(vehicle["heading"]["value"], 0.1, 3601) % 360.0,
        "elev_m": altitude if -409.5 <= altitude <= 6143.9 else math.nan,
        "accel_mps2": si(vehicle["longitudinalAcceleration"]["value"], 0.1, 161),
        "accuracy_m": min(si(position["ellipse"]["semiMajor"], 0.01, 4095) / math.sqrt(-2 * math.log(0.05)), 12.7),
        "length_m": length if length <= 40.95 else math.nan,
        "width_m": si(vehicle["vehicleWidth"], 0.1, 62),
    }  # fmt: skip
