"""The tests between two cars, one row per vehicle as a follower: response, ranging, and who is to blame.

A wave of readings goes through `step_links` after the model has judged each by itself: READING holds what the model
left standing (recovered values where it rejected), so that a single bad reading is not a matter for this room.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from scipy.special import expit

from headway.core.consistency.attribution import DOUBT, follower_log_odds, held
from headway.core.consistency.forward_range import RANGING, RangingParams, ranging_relink, ranging_step
from headway.core.consistency.response import RESPONSE, ResponseParams, response_relink, response_step
from headway.core.statistics.test_result import CHECK, check_budget
from headway.core.types.records import Kind, Records, Sensor

LINK = np.dtype(
    [
        ("leader", "i8"),  # row of the last leader, counted from 1; 0: never one
        ("log_odds", "f8"),  # the statement about this pair that stands: above 0 the follower lies
        ("log_odds_t_s", "f8"),
        ("ranging_behind", DOUBT),  # what the last car that followed this one has to say
        ("response_behind", DOUBT),
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

LOCATION, SPEED = int(Sensor.LOCATION), int(Sensor.SPEED)
NONE, RESPONSE_KIND, RANGE_KIND = int(Kind.NONE), int(Kind.RESPONSE), int(Kind.RANGE)


RANGING_SHARE = 0.1
"""Of the budget: a lie stands far above any gate of the forward sensor, so that it can do with little."""


class LinkParams(NamedTuple):
    """Numbers of both tests."""

    response: ResponseParams
    ranging: RangingParams


def link_params(budget_per_hour: float) -> LinkParams:
    """Return the parameters that keep false alarms of both tests together within `budget_per_hour` per pair."""
    return LinkParams(
        ResponseParams(check_budget((1.0 - RANGING_SHARE) * budget_per_hour)),
        RangingParams(check_budget(RANGING_SHARE * budget_per_hour)),
    )


@njit(cache=True)
def step_pair(link: Any, leader: int, z: Any, p: LinkParams, verdict: Any) -> None:
    """Both tests of one row (LINK) with `leader`, -1 for none, on one READING: all of the verdict but who is to blame.

    It depends on this row alone, so that it can be computed again from the row and its readings.
    """
    if leader >= 0 and link.leader != leader + 1:
        link.leader, link.log_odds = leader + 1, 0.0
        response_relink(link.response)
        ranging_relink(link.ranging)
    response_step(link.response, z, p.response, verdict.response)
    ranging_step(link.ranging, z, p.ranging, verdict.ranging)
    verdict.kind = NONE
    if leader < 0:
        return
    if verdict.ranging.anomalous:
        verdict.kind = RANGE_KIND
    elif verdict.response.anomalous:
        verdict.kind = RESPONSE_KIND


@njit(cache=True)
def step_links(links: Any, rows: Any, leaders: Any, readings: Any, p: LinkParams, verdicts: Any) -> None:
    """Judge a wave: distinct `rows` (B,) with `leaders` (B,), -1 for none, `readings` and `verdicts` (B,).

    `links` (C,) of LINK is changed in place.
    """
    for i in range(rows.size):
        link, z, verdict = links[rows[i]], readings[i], verdicts[i]
        step_pair(link, leaders[i], z, p, verdict)
        verdict.follower_log_odds = 0.0
        if leaders[i] < 0:
            continue
        leader, own, due = links[leaders[i]], link.response.own_unusual, link.response.due_unusual
        hand_on(link.response.doubt, leader.response_behind)
        hand_on(link.ranging.doubt, leader.ranging_behind)
        if verdict.kind == RANGE_KIND:
            state(link, follower_log_odds(link.ranging_behind, leader.ranging.doubt, own, due, z.t_s), z.t_s)
        elif verdict.kind == RESPONSE_KIND:
            state(link, follower_log_odds(link.response_behind, leader.response.doubt, own, due, z.t_s), z.t_s)
        verdict.follower_log_odds = link.log_odds


@njit(cache=True)
def hand_on(doubt: Any, behind: Any) -> None:
    """Tell the leader what its follower has to say."""
    behind.log_odds, behind.t_s = doubt.log_odds, doubt.t_s


@njit(cache=True)
def state(link: Any, log_odds: float, t_s: float) -> None:
    """Take a statement about the pair, unless a stronger one was made just before."""
    if abs(log_odds) >= abs(held(link.log_odds, link.log_odds_t_s, t_s)):
        link.log_odds, link.log_odds_t_s = log_odds, t_s


@njit(cache=True)
def standing(readings: Any, verdicts: Any) -> Any:
    """Return the `readings` (B,) with recovered values in the place of those that the filter's `verdicts` reject."""
    stand = readings.copy()
    for i in range(readings.size):
        if verdicts[i].sensor & LOCATION:
            stand[i].x_m = verdicts[i].x_m
        if verdicts[i].sensor & SPEED:
            stand[i].v_mps = verdicts[i].v_mps
    return stand


def link_said(links: Records, verdicts: Records) -> Records:
    """Return what the tests between two cars say, as VERDICT (B,); the estimate in it is the filter's."""
    said = verdicts.copy()
    check = np.where(links["kind"] == Kind.RANGE, links["ranging"], links["response"])
    for name in ("statistic", "gate", "p_value"):
        said[name] = check[name]
    said["kind"], said["sensor"], said["anomalous"] = links["kind"], Sensor.LINK, links["kind"] != Kind.NONE
    said["confidence"] = expit(np.abs(links["follower_log_odds"]))
    return said
