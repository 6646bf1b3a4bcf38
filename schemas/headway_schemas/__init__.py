"""The wire contract: messages, key expressions and encodings. Every client of the service starts here."""

from headway_schemas.bsm import WIRE_VERSION, Bsm, Leader
from headway_schemas.event import Event, Evidence, Innovation, Kind, Phase, Recovered, Sensor
from headway_schemas.keys import Keys
from headway_schemas.state import Health, PairState, RejectedCopy, SensorQuality

__all__ = [
    "WIRE_VERSION",
    "Bsm",
    "Event",
    "Evidence",
    "Health",
    "Innovation",
    "Keys",
    "Kind",
    "Leader",
    "PairState",
    "Phase",
    "Recovered",
    "RejectedCopy",
    "Sensor",
    "SensorQuality",
]
