"""ETSI cooperative awareness messages in the JSON of vanetza-nap and of its-client, as compact records of our own.

The two differ in their names. In both, an integer is in the units of the standard, with its values for unavailable; a
number with a fraction, which vanetza-nap writes for what it converts, is in SI units and degrees. The time is that of
`generationDeltaTime`, milliseconds modulo 65,536, nearest to the time of the envelope.
"""

import math
from typing import Any, Final

from headway.feeds.instants import nearest_us
from headway.feeds.kinds import kind_of
from headway.feeds.refusal import MALFORMED, OTHER_MESSAGE, OUT_OF_RANGE, UNAVAILABLE, UNREADABLE_TIME, Refusal, Result
from headway.feeds.uper import CAM_PERIOD_US, CAM_SIGMAS, ITS_EPOCH_US
from headway_schemas.bsm import WIRE_VERSION

_DELTA_MAX: Final = 65_535
_EPOCH_MS_MIN: Final = 100_000_000_000
"""Unix time in milliseconds is greater, in seconds smaller."""
_EPOCH_MAX: Final = 100_000_000_000_000
_ACCURACY_MAX_M, _LENGTH_MAX_M = 12.7, 40.95
_ELEVATION_MIN_M, _ELEVATION_MAX_M = -409.5, 6143.9


def from_cam(message: object, received_us: int) -> Result:
    """Convert one message; its time is the one nearest to that of its envelope, else to `received_us`."""
    if not isinstance(message, dict):
        return Refusal(MALFORMED, "no CAM")
    reference_us = _envelope_us(message, received_us)
    body = _first(message, "message", "fields") or message
    header = _first(body, "header")
    cam = _first(body, "cam") or body
    parameters = _first(cam, "camParameters", "cam_parameters") or cam
    basic = _first(parameters, "basicContainer", "basic_container")
    if not basic:
        return Refusal(OTHER_MESSAGE, kind_of(message) or "no cooperative awareness message")
    if isinstance(reference_us, Refusal):
        return reference_us
    fast = _first(parameters, "highFrequencyContainer", "high_frequency_container")
    fast = _first(fast, "basicVehicleContainerHighFrequency", "basic_vehicle_container_high_frequency") or fast
    t_us = _t_us(_value(cam, "generationDeltaTime", "generation_delta_time"), reference_us)
    if isinstance(t_us, Refusal):
        return t_us
    station = _value(header, "stationID", "stationId", "station_id")
    station = _value({**message, **body}, "stationID", "stationId", "station_id") if station is None else station
    position = _first(basic, "referencePosition", "reference_position")
    ellipse = _first(position, "positionConfidenceEllipse", "position_confidence_ellipse") or _first(
        _first(basic, "confidence"), "position_confidence_ellipse"
    )
    return [
        WIRE_VERSION,
        str(station) if type(station) is int else station,
        0,
        t_us,
        _si(_value(position, "latitude"), 10_000_000, unavailable=900_000_001),
        _si(_value(position, "longitude"), 10_000_000, unavailable=1_800_000_001),
        _si(_value(fast, "speed"), 100, unavailable=16_383),
        _heading(_si(_value(fast, "heading"), 10, unavailable=3601)),
        _within(_si(_value(position, "altitude"), 100, unavailable=800_001), _ELEVATION_MIN_M, _ELEVATION_MAX_M),
        _si(_value(fast, "longitudinalAcceleration", "longitudinal_acceleration"), 10, unavailable=161),
        _accuracy(_si(_value(ellipse, *_SEMI_MAJOR), 100, unavailable=4095)),
        _within(_si(_value(fast, "vehicleLength", "vehicle_length"), 10, unavailable=1023), 0.01, _LENGTH_MAX_M),
        _si(_value(fast, "vehicleWidth", "vehicle_width"), 10, unavailable=62),
    ]


_SEMI_MAJOR: Final = (
    "semiMajorConfidence",
    "semiMajorAxisLength",
    "semi_major_confidence",
    "semi_major",
    "semiMajorConf",
)


def _envelope_us(message: dict[str, Any], received_us: int) -> int | Refusal:
    """Return the time of `timestamp`, Unix time in milliseconds (its-client) or seconds (vanetza-nap)."""
    timestamp = message.get("timestamp")
    if timestamp is None:
        return received_us
    if type(timestamp) not in (int, float) or not 0 < timestamp < _EPOCH_MAX:
        return Refusal(UNREADABLE_TIME, "timestamp is no Unix time")
    return round(float(timestamp) * (1_000 if timestamp > _EPOCH_MS_MIN else 1_000_000))


def _t_us(delta: object, reference_us: int) -> int | Refusal:
    if delta is None:
        return Refusal(UNAVAILABLE, "no generationDeltaTime")
    if type(delta) is not int:
        return Refusal(MALFORMED, "generationDeltaTime is not an integer")
    if not 0 <= delta <= _DELTA_MAX:
        return Refusal(OUT_OF_RANGE, f"generationDeltaTime is not within 0 to {_DELTA_MAX}")
    return nearest_us(delta * 1000 + ITS_EPOCH_US, CAM_PERIOD_US, reference_us)


def _first(part: dict[str, Any], *names: str) -> dict[str, Any]:
    """Return the first map of these names, an empty one where there is none."""
    return next((part[name] for name in names if isinstance(part.get(name), dict)), {})


def _value(part: dict[str, Any], *names: str) -> Any:
    """Return the value of the first of these names; of a value with its confidence, the value."""
    value = next((part[name] for name in names if part.get(name) is not None), None)
    if isinstance(value, dict):
        return next((inner for name, inner in value.items() if name == "value" or name.endswith("Value")), None)
    return value


def _si(value: object, per_unit: int, *, unavailable: int) -> Any:
    if type(value) is int:
        return None if value == unavailable else max(-(2**53), min(value, 2**53)) / per_unit
    if type(value) is not float:
        return None if value is None else type(value).__name__
    return None if math.isclose(value, unavailable / per_unit, rel_tol=1e-9) else value


def _heading(value: Any) -> Any:
    return 0.0 if value == 360.0 else value  # noqa: PLR2004 - both are north


def _accuracy(value: Any) -> Any:
    return min(value / CAM_SIGMAS, _ACCURACY_MAX_M) if type(value) is float and value >= 0.0 else value


def _within(value: Any, low: float, high: float) -> Any:
    """Return None for a number beyond what a record holds, of a field that no verdict depends on."""
    return None if type(value) is float and not low <= value <= high else value
