"""The tests between two cars, one row per vehicle as a follower: response, ranging, and who is to blame.

A wave of readings goes through `step_links` after the model has judged each by itself: READING holds what the model
left standing (recovered values where it rejected), so that a single bad reading is not a matter for this room.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from headway.core.check import CHECK
from headway.core.ranging import RANGING, RangingParams, ranging_relink, ranging_step
from headway.core.records import Kind
from headway.core.response import RESPONSE, ResponseParams, response_relink, response_step
from headway.core.suspect import WITNESS, follower_log_odds, testify
from headway.core.tail import TailParams

LINK = np.dtype(
    [
        ("leader", "i8"),  # row of the leader, counted from 1; 0: nobody ahead
        ("witness", WITNESS),
        ("ranging", RANGING),
        ("response", RESPONSE),
    ],
    align=True,
)
"""One row per vehicle; all zeros is a vehicle not heard yet."""

LINK_VERDICT = np.dtype(
    [
        ("kind", "i8"),  # Kind.RESPONSE or Kind.RANGE while anomalous, else Kind.NONE
        ("follower_log_odds", "f8"),  # above 0 the follower is the suspect, below 0 its leader
        ("ranging", CHECK),
        ("response", CHECK),
    ],
    align=True,
)

NONE, RESPONSE_KIND, RANGE_KIND = int(Kind.NONE), int(Kind.RESPONSE), int(Kind.RANGE)


class LinkParams(NamedTuple):
    """Both tests; each has half of the budget given to links."""

    response: ResponseParams
    ranging: RangingParams


def link_params(budget_per_hour: float) -> LinkParams:
    """Return the parameters that keep false alarms of both tests together within `budget_per_hour` per pair."""
    tail = TailParams(budget_per_hour=0.5 * budget_per_hour)
    return LinkParams(ResponseParams(tail), RangingParams(tail))


@njit(cache=True)
def step_links(links: Any, rows: Any, leaders: Any, readings: Any, p: LinkParams, verdicts: Any) -> None:
    """Judge a wave: distinct `rows` (B,) with `leaders` (B,), -1 for none, `readings` and `verdicts` (B,).

    `links` (C,) of LINK is changed in place.
    """
    for i in range(rows.size):
        link, z, verdict = links[rows[i]], readings[i], verdicts[i]
        if link.leader != leaders[i] + 1:
            link.leader = leaders[i] + 1
            response_relink(link.response)
            ranging_relink(link.ranging)
        response_step(link.response, z, p.response, verdict.response)
        ranging_step(link.ranging, z, p.ranging, verdict.ranging)
        verdict.kind, verdict.follower_log_odds = NONE, 0.0
        if leaders[i] >= 0:
            leader = links[leaders[i]]
            said = 0.0
            if not verdict.response.warming:
                said = verdict.response.statistic
            if not verdict.ranging.warming:
                said = max(said, verdict.ranging.statistic)
            testify(link.witness, leader.witness, said, z.t_s)
            verdict.follower_log_odds = verdict.response.lean
            if verdict.ranging.anomalous:
                verdict.kind = RANGE_KIND
            elif verdict.response.anomalous:
                verdict.kind = RESPONSE_KIND
