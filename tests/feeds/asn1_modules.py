"""Modules of ASN.1 of our own, from the published ranges: an independent oracle of the kernels (asn1tools)."""

from functools import cache
from typing import Any

import asn1tools

BSM = """
Bsm DEFINITIONS AUTOMATIC TAGS ::= BEGIN
BasicSafetyMessage ::= SEQUENCE {
    coreData CoreData, partII SEQUENCE (SIZE (1..8)) OF PartII OPTIONAL,
    regional SEQUENCE (SIZE (1..4)) OF PartII OPTIONAL,
    ...
}
PartII ::= SEQUENCE { id INTEGER (0..63), content OCTET STRING }
CoreData ::= SEQUENCE {
    msgCnt INTEGER (0..127), id OCTET STRING (SIZE (4)), secMark INTEGER (0..65535),
    lat INTEGER (-900000000..900000001), long INTEGER (-1799999999..1800000001), elev INTEGER (-4096..61439),
    accuracy SEQUENCE { semiMajor INTEGER (0..255), semiMinor INTEGER (0..255), orientation INTEGER (0..65535) },
    transmission ENUMERATED { neutral, park, forward, reverse, reserved1, reserved2, reserved3, unavailable },
    speed INTEGER (0..8191), heading INTEGER (0..28800), angle INTEGER (-126..127),
    accelSet SEQUENCE {
        long INTEGER (-2000..2001), lat INTEGER (-2000..2001), vert INTEGER (-127..127), yaw INTEGER (-32767..32767)
    },
    brakes SEQUENCE {
        wheels BIT STRING (SIZE (5)), traction Four, abs Four, scs Four,
        boost ENUMERATED { unavailable, off, on }, aux Four
    },
    size SEQUENCE { width INTEGER (0..1023), length INTEGER (0..4095) }
}
Four ::= ENUMERATED { unavailable, off, on, engaged }
END
"""
CAM = """
Cam DEFINITIONS AUTOMATIC TAGS ::= BEGIN
CAM ::= SEQUENCE {
    header SEQUENCE {
        protocolVersion INTEGER (0..255), messageID INTEGER (0..255), stationID INTEGER (0..4294967295)
    },
    cam SEQUENCE { generationDeltaTime INTEGER (0..65535), camParameters CamParameters }
}
CamParameters ::= SEQUENCE {
    basicContainer BasicContainer,
    highFrequencyContainer CHOICE { vehicle Vehicle, rsu SEQUENCE { zones OCTET STRING OPTIONAL, ... }, ... },
    lowFrequencyContainer OCTET STRING OPTIONAL, specialVehicleContainer OCTET STRING OPTIONAL, ...
}
BasicContainer ::= SEQUENCE {
    stationType INTEGER (0..255),
    referencePosition SEQUENCE {
        latitude INTEGER (-900000000..900000001), longitude INTEGER (-1800000000..1800000001),
        ellipse SEQUENCE { semiMajor INTEGER (0..4095), semiMinor INTEGER (0..4095), orientation INTEGER (0..3601) },
        altitude SEQUENCE { value INTEGER (-100000..800001), confidence INTEGER (0..15) }
    }, ...
}
Vehicle ::= SEQUENCE {
    heading SEQUENCE { value INTEGER (0..3601), confidence INTEGER (1..127) },
    speed SEQUENCE { value INTEGER (0..16383), confidence INTEGER (1..127) },
    driveDirection ENUMERATED { forward, backward, unavailable },
    vehicleLength SEQUENCE { value INTEGER (1..1023), confidence INTEGER (0..4) },
    vehicleWidth INTEGER (1..62),
    longitudinalAcceleration SEQUENCE { value INTEGER (-160..161), confidence INTEGER (0..102) },
    curvature SEQUENCE { value INTEGER (-1023..1023), confidence INTEGER (0..7) },
    curvatureCalculationMode ENUMERATED { yawRateUsed, yawRateNotUsed, unavailable, ... },
    yawRate SEQUENCE { value INTEGER (-32766..32767), confidence INTEGER (0..8) },
    accelerationControl BIT STRING (SIZE (7)) OPTIONAL, lanePosition INTEGER (-1..14) OPTIONAL,
    steeringWheelAngle SEQUENCE { value INTEGER (-511..512), confidence INTEGER (1..127) } OPTIONAL,
    lateralAcceleration SEQUENCE { value INTEGER (-160..161), confidence INTEGER (0..102) } OPTIONAL,
    verticalAcceleration SEQUENCE { value INTEGER (-160..161), confidence INTEGER (0..102) } OPTIONAL,
    performanceClass INTEGER (0..7) OPTIONAL, cenDsrcTollingZone OCTET STRING OPTIONAL
}
END
"""


@cache
def compiled(module: str) -> Any:
    """Return the coder of a module."""
    return asn1tools.compile_string(module, "uper")


def encode_bsm(core: dict[str, Any], part_ii: list[dict[str, Any]] | None = None) -> bytes:
    """Return a MessageFrame with a BSM."""
    message = {"coreData": core} | ({"partII": part_ii} if part_ii else {})
    return frame_of(compiled(BSM).encode("BasicSafetyMessage", message))


def frame_of(value: bytes, message_id: int = 20) -> bytes:
    """Return a MessageFrame: the id, the length of the open type, the value."""
    size = len(value)
    length = bytes([size]) if size < 128 else (0x8000 | size).to_bytes(2, "big")
    return message_id.to_bytes(2, "big") + length + value


def encode_cam(cam: dict[str, Any]) -> bytes:
    """Return a CAM."""
    octets: bytes = compiled(CAM).encode("CAM", cam)
    return octets
