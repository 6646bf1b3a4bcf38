"""What a message is that is no basic safety message, by the names that its form has."""

from collections.abc import Mapping
from typing import Any, Final

BSM: Final = "BasicSafetyMessage"
J2735_NAMES: Final = {
    "MapData": 18,
    "SPAT": 19,
    BSM: 20,
    "CommonSafetyRequest": 21,
    "EmergencyVehicleAlert": 22,
    "IntersectionCollision": 23,
    "NMEAcorrections": 24,
    "ProbeDataManagement": 25,
    "ProbeVehicleData": 26,
    "RoadSideAlert": 27,
    "RTCMcorrections": 28,
    "SignalRequestMessage": 29,
    "SignalStatusMessage": 30,
    "TravelerInformation": 31,
    "PersonalSafetyMessage": 32,
    "RoadSafetyMessage": 33,
    "SensorDataSharingMessage": 41,
}
"""Message types of J2735 and their DSRCmsgID."""
_CAM_FIELDS: Final = frozenset(
    {"cam", "camParameters", "generationDeltaTime", "generation_delta_time", "basicContainer", "basic_container"}
)
_GEOJSON: Final = frozenset({"Feature", "FeatureCollection", "Point", "LineString", "Polygon", "MultiPoint"})
_ITS_MESSAGES: Final = frozenset({"cam", "cpm", "denm", "mapem", "spatem", "ivim", "srem", "ssem", "vam", "mcm"})
"""Values of `message_type` or `type` in the JSON of its-client, and names of the body of an ITS message."""
_WRAPPERS: Final = ("payload", "fields", "message", "data", "MessageFrame", "value")
_DEPTH_MAX: Final = 8


def kind_of(message: object) -> str | None:
    """Return in words what a JSON message is; None if it is unknown. No text of the sender is in it."""
    for _ in range(_DEPTH_MAX):
        if not isinstance(message, Mapping):
            return None
        if kind := _kind(message):
            return kind
        message = next((message[name] for name in _WRAPPERS if name in message), None)
    return None


def _kind(message: Mapping[str, Any]) -> str | None:
    number = message.get("messageId")
    name = next(
        (name for name, known in J2735_NAMES.items() if (name in message or number == known) and name != BSM), None
    )
    its = next((value for field in ("message_type", "type") if _is_in(value := message.get(field), _ITS_MESSAGES)), "")
    its = its or next((name for name in _ITS_MESSAGES if name in message), "")
    kind = None
    if name is not None:
        kind = f"a {name}, no basic safety message"
    elif its == "cam" or not _CAM_FIELDS.isdisjoint(message):
        kind = "a CAM: the encoding application/json;cam reads it"
    elif its:
        kind = f"a message of type {its}, no awareness message"
    elif _is_in(message.get("type"), _GEOJSON):
        kind = "GeoJSON, no basic safety message"
    elif "t_us" in message:
        kind = "a record of BSM v1: the encoding application/json;bsm.v1 reads it"
    elif not {BSM, "coreData", "secMark"}.isdisjoint(message):
        kind = "a basic safety message: the encodings of J2735 read it"
    return kind


def _is_in(value: object, names: frozenset[str]) -> bool:
    return isinstance(value, str) and value in names
