"""The tests between two vehicles, one row for each vehicle as a follower: response, range, and attribution.

`step_pair_tests` takes a round of readings after the motion model. Each READING then holds the recovered value where
the model rejected a sensor, so a single bad reading does not reach these tests.
"""

from math import exp
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from headway.core.consistency.attribution import (
    FAULT_LOG_ODDS,
    decayed,
    follower_log_odds,
    is_consistent,
    is_inconsistent,
    is_witnessed,
)
from headway.core.consistency.forward_range import RANGING, RangingParams, ranging_reset_leader, ranging_step
from headway.core.consistency.response import RESPONSE, ResponseParams, response_reset_leader, response_step
from headway.core.runtime.prefetch import prefetch_row
from headway.core.statistics.test_result import CHECK, check_budget
from headway.core.types.records import Kind, Records, Sensor

PAIR_TESTS = np.dtype(
    [
        ("leader", "i8"),  # row of the last leader, counted from 1; 0: none so far
        ("log_odds", "f8"),  # of the attribution in force: above 0 the follower is faulty
        ("log_odds_updated_s", "f8"),
        ("ranging_behind", FAULT_LOG_ODDS),  # of the pair of this vehicle's last follower
        ("response_behind", FAULT_LOG_ODDS),
        ("response_behind_both", FAULT_LOG_ODDS),  # of the pair behind that one,
        ("response_ahead", FAULT_LOG_ODDS),  # and of the pair of this vehicle's leader with its own
        ("ranging", RANGING),
        ("response", RESPONSE),
    ],
    align=True,
)
"""State of one vehicle; all zeros is a vehicle without a message."""

PAIR_TEST_VERDICT = np.dtype(
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
"""Share of the budget for the range test; a fault exceeds any gate of the forward sensor by far."""


class PairTestParams(NamedTuple):
    """Parameters of both tests."""

    response: ResponseParams
    ranging: RangingParams


def pair_test_params(budget_per_hour: float) -> PairTestParams:
    """Return parameters with which both tests together raise at most `budget_per_hour` false alarms per pair."""
    return PairTestParams(
        ResponseParams(check_budget((1.0 - RANGING_SHARE) * budget_per_hour)),
        RangingParams(check_budget(RANGING_SHARE * budget_per_hour)),
    )


@njit(cache=True, error_model="numpy")
def step_pair(pair_test: Any, leader: int, z: Any, p: PairTestParams, verdict: Any) -> None:
    """Run both tests of one row (PAIR_TESTS) with `leader` (-1: none) on one READING; write all but the suspect.

    The result depends on this row alone, so evidence can replay it from the row and its readings.
    """
    if leader >= 0 and pair_test.leader != leader + 1:
        pair_test.leader, pair_test.log_odds = leader + 1, 0.0
        response_reset_leader(pair_test.response)
        ranging_reset_leader(pair_test.ranging)
    response_step(pair_test.response, z, p.response, verdict.response)
    ranging_step(pair_test.ranging, z, p.ranging, verdict.ranging)
    verdict.kind = NONE
    if leader < 0:
        return
    if verdict.ranging.anomalous:
        verdict.kind = RANGE_KIND
    elif verdict.response.anomalous:
        verdict.kind = RESPONSE_KIND


@njit(cache=True, error_model="numpy")
def step_pair_tests(pair_tests: Any, rows: Any, leaders: Any, readings: Any, p: PairTestParams, verdicts: Any) -> None:
    """Test a round: distinct `rows` (B,) with `leaders` (B,), -1 for none, `readings` and `verdicts` (B,).

    `pair_tests` (C,) of PAIR_TESTS is changed in place.
    """
    for i in range(rows.size):
        if i + 1 < rows.size:
            prefetch_row(pair_tests, rows[i + 1], 0, pair_tests.itemsize)
        pair_test, z, verdict = pair_tests[rows[i]], readings[i], verdicts[i]
        step_pair(pair_test, leaders[i], z, p, verdict)
        verdict.follower_log_odds = 0.0
        if leaders[i] < 0:
            continue
        leader, response, ranging = pair_tests[leaders[i]], pair_test.response, pair_test.ranging
        propagate(response.pair_fault, leader.response_behind)
        propagate(pair_test.response_behind, leader.response_behind_both)
        propagate(leader.response.pair_fault, pair_test.response_ahead)
        propagate(ranging.pair_fault, leader.ranging_behind)
        if verdict.kind != NONE:
            behind, ahead = pair_test.response_behind, leader.response.pair_fault
            if verdict.kind == RANGE_KIND:
                behind, ahead = pair_test.ranging_behind, leader.ranging.pair_fault
            elif not is_witnessed(behind, ahead, pair_test.response_behind_both, leader.response_ahead, z.t_s):
                verdict.kind = NONE
                verdict.follower_log_odds = pair_test.log_odds
                continue
            surprises = response.follower_surprise, response.leader_surprise
            log_odds = follower_log_odds(behind, ahead, *surprises, z.t_s)
            if verdict.kind == RANGE_KIND and not (is_consistent(behind, z.t_s) or is_inconsistent(ahead, z.t_s)):
                log_odds = abs(log_odds)  # the range is the follower's alone: no other pair supports it
            hold_attribution(pair_test, log_odds, z.t_s)
        verdict.follower_log_odds = pair_test.log_odds


@njit(cache=True, error_model="numpy")
def propagate(pair_fault: Any, to: Any) -> None:
    """Copy the fault log odds of a pair to the row of a neighbour."""
    to.log_odds, to.t_s = pair_fault.log_odds, pair_fault.t_s


@njit(cache=True, error_model="numpy")
def hold_attribution(pair_test: Any, log_odds: float, t_s: float) -> None:
    """Set the attribution of a pair, unless a stronger recent one is in force."""
    if abs(log_odds) >= abs(decayed(pair_test.log_odds, pair_test.log_odds_updated_s, t_s)):
        pair_test.log_odds, pair_test.log_odds_updated_s = log_odds, t_s


@njit(cache=True, error_model="numpy")
def substitute_rejected(readings: Any, verdicts: Any) -> Any:
    """Return the `readings` (B,) with the recovered values of the sensors that the model's `verdicts` reject."""
    substituted = readings.copy()
    for i in range(readings.size):
        if verdicts[i].sensor & LOCATION:
            substituted[i].x_m = verdicts[i].x_m
        if verdicts[i].sensor & SPEED:
            substituted[i].v_mps = verdicts[i].v_mps
    return substituted


def pair_verdicts(pair_tests: Records, verdicts: Records) -> Records:
    """Return the results of the pair tests as VERDICT (B,); the estimates are those of the motion model."""
    result = verdicts.copy()
    check = np.where(pair_tests["kind"] == Kind.RANGE, pair_tests["ranging"], pair_tests["response"])
    for name in ("statistic", "gate", "p_value"):
        result[name] = check[name]
    result["kind"], result["sensor"] = pair_tests["kind"], Sensor.LINK
    result["anomalous"] = pair_tests["kind"] != Kind.NONE
    result["confidence"] = [1.0 / (1.0 + exp(-abs(odds))) for odds in pair_tests["follower_log_odds"].tolist()]
    return result
