import json
import math

import pytest
from pydantic import ValidationError

from headway_schemas import Health, PairState, RejectedCopy
from headway_schemas.state import Standing

HEALTH = Health(
    instance="main",
    site="s",
    t_us=0,
    version="0.1.0",
    model="headway",
    config_hash="0",
    ready=True,
    uptime_s=1.5,
    vehicles=2,
    pairs=1,
    capacity=100,
    queue_depth=0,
    queue_limit=1000,
    scored=10,
    warming=4,
    rejected={"duplicate": 1},
    lost={},
    events=0,
    latency_ms={"p50": 1.2, "max": math.nan},
)
STATE = PairState(site="s", follower="b", leader=None, t_us=0, standing=Standing.NORMAL, gap_m=math.nan)
COPY = RejectedCopy(
    reason="malformed",
    detail="not json",
    key="v2x/s/bsm/a",
    encoding="application/json",
    size=3,
    payload=b"\xff\x00",
    truncated=True,
    received_us=0,
)


@pytest.mark.parametrize("message", [HEALTH, STATE, COPY])
def test_json_there_and_back(message: Health | PairState | RejectedCopy) -> None:
    assert type(message).model_validate_json(message.model_dump_json()) == message


def test_unknown_numbers_are_null() -> None:
    assert json.loads(STATE.model_dump_json())["gap_m"] is None
    assert json.loads(HEALTH.model_dump_json())["latency_ms"] == {"p50": 1.2, "max": None}


def test_a_reason_is_a_label() -> None:
    with pytest.raises(ValidationError, match="reason"):
        RejectedCopy.model_validate(dict(COPY) | {"reason": "Not a label"})
