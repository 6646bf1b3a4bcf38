"""Encodings of payloads on the bus, as `media type;schema`."""

from typing import Final

BSM_MSGPACK: Final = "application/msgpack;bsm.v1"
BSM_JSON: Final = "application/json;bsm.v1"
J2735_RAW: Final = "application/json;j2735.raw"
"""SAE J2735 JSON with its integers and sentinels as they are."""
J2735_ODE: Final = "application/json;j2735.ode"
"""The JSON of the USDOT Operational Data Environment: SI values, null for an unavailable speed."""
J2735_UPER: Final = "application/j2735;uper"
"""SAE J2735 MessageFrame in unaligned PER, also behind IEEE 1609.3 and 1609.2 headers, as octets or hex text."""
CAM_UPER: Final = "application/cam;uper"
"""ETSI CAM in unaligned PER."""
CAM_JSON: Final = "application/json;cam"
"""ETSI CAM in the JSON of vanetza-nap or its-client."""

EVENT_JSON: Final = "application/json;event.v1"
PAIR_STATE_JSON: Final = "application/json;pair_state.v1"
SENSOR_QUALITY_JSON: Final = "application/json;sensor_quality.v1"
HEALTH_JSON: Final = "application/json;health.v1"
REJECTED_JSON: Final = "application/json;rejected.v1"
HANDLING_JSON: Final = "application/json;handling.v1"

VEHICLE_STATE: Final = "application/octet-stream;vehicle_state.v1"
"""The state of a vehicle from site to site; only the same version in the same configuration reads it."""

EVENTS_JSON: Final = "application/json;events.v1"
"""An array of events: the answer of the queryable `alerts`."""
PAIR_STATES_JSON: Final = "application/json;pair_states.v1"
"""An array of pair states: the answer of the queryable `pairs`."""
HANDLINGS_JSON: Final = "application/json;handlings.v1"
"""An array of handlings: the answer of the queryable `handling`."""
