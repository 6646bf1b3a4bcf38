"""Encodings of payloads on the bus, as `media type;schema`."""

from typing import Final

BSM_MSGPACK: Final = "application/msgpack;bsm.v1"
BSM_JSON: Final = "application/json;bsm.v1"
J2735_RAW: Final = "application/json;j2735.raw"
"""SAE J2735 JSON with its integers and sentinels as they are."""
J2735_ODE: Final = "application/json;j2735.ode"
"""The JSON of the USDOT Operational Data Environment: SI values, null for an unavailable speed."""

EVENT_JSON: Final = "application/json;event.v1"
PAIR_STATE_JSON: Final = "application/json;pair_state.v1"
HEALTH_JSON: Final = "application/json;health.v1"
REJECTED_JSON: Final = "application/json;rejected.v1"

EVENTS_JSON: Final = "application/json;events.v1"
"""An array of events: the answer of the queryable `alerts`."""
PAIR_STATES_JSON: Final = "application/json;pair_states.v1"
"""An array of pair states: the answer of the queryable `pairs`."""
