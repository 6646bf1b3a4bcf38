"""The ten modes against their plain twin, and the behaviour they are there for."""

import numpy as np
import pytest
from core.estimation.imm import plain_modes as plain

from headway.core.estimation.imm.modes import (
    HEALTHY,
    MODE_COUNT,
    MODE_TABLE,
    SINGLE_FAULT_MODES,
    Fault,
    Mode,
    sensor_fault_probability,
)
from headway.core.estimation.imm.state import IMM_WORKSPACE, MODES, PRUNE_DOUBLES_ABOVE, estimate, initialise_modes
from headway.core.estimation.imm.step import headway_params
from headway.core.estimation.imm.update import PRUNE_RECOVERY_BELOW_NIS, Motion, update
from headway.core.estimation.kinematics import SIZE
from headway.core.types.config import DetectorConfig

P = headway_params(DetectorConfig()).modes
R = np.array([1e-4, 1e-4])
Q, WALK, MANOEUVRE, DEAD_ZONE_MPS = 0.2, 1e-5, 0.01, 0.4
TRIANGLE = np.triu_indices(5)


class Kernel:
    """A row, and what `update` finds."""

    def __init__(self, x_m, v_mps):
        self.row, self.imm = np.zeros(1, MODES)[0], np.zeros(1, IMM_WORKSPACE)[0]
        initialise_modes(self.row, x_m, v_mps, R, P)

    @property
    def mode_probability(self):
        return self.row["mode_probability"]

    def step(self, h, z, unexplained=1.0):
        update(self.row, h, np.asarray(z), R, Motion(Q, WALK, MANOEUVRE, unexplained, DEAD_ZONE_MPS), 0, P, self.imm)


def gaussians(kernel):
    made = []
    for m, weight in zip(
        [*kernel.row["single"].T[:SINGLE_FAULT_MODES], *kernel.row["double"].T], kernel.mode_probability, strict=True
    ):
        cov = np.zeros((5, 5))
        cov[TRIANGLE] = m[5:]
        made.append(plain.Gaussian(float(weight), m[:5].copy(), cov + np.triu(cov, 1).T))
    return made


def readings(rng, kind, n=60):
    """A car that brakes gently, with a fault from sample 20 to 40."""
    t_s = 0.1 * np.arange(n)
    x, v = 12.0 * t_s - 0.4 * t_s**2, 12.0 - 0.8 * t_s
    z = np.stack([x, v], axis=1) + rng.normal(0.0, 0.01, (n, 2))
    fault = slice(20, 40)
    if kind == "bias":
        z[fault, 0] += 0.7
    elif kind == "drift":
        z[fault, 1] += np.linspace(0.0, 0.8, 20)
    elif kind == "noise":
        z[fault, 1] += rng.normal(0.0, 1.0, 20)
    elif kind == "double":
        z[fault, 0] += 1.3
        z[25:45, 1] += rng.normal(0.0, 1.0, 20)
    elif kind == "negative":
        z[fault, 1] = -1.0
    return t_s, z


@pytest.mark.parametrize("unexplained", [1.0, 0.1])
@pytest.mark.parametrize("kind", ["healthy", "bias", "drift", "noise", "double", "negative"])
def test_every_step_agrees_with_the_plain_twin(kind: str, unexplained: float) -> None:
    """From the same state each time, so that rounding does not add up where two modes are equally likely."""
    t_s, z = readings(np.random.default_rng(4), kind)
    came = np.arange(len(t_s)) % 7 != 5
    t_s, z = t_s[came], z[came]
    kernel = Kernel(*z[0])
    for k in range(1, len(t_s)):
        h = float(t_s[k] - t_s[k - 1])
        motion, manoeuvring = Motion(Q, WALK, MANOEUVRE, unexplained, DEAD_ZONE_MPS), float(kernel.row["manoeuvring"])
        pruning = PRUNE_DOUBLES_ABOVE, PRUNE_RECOVERY_BELOW_NIS
        expected, ended = plain.step(gaussians(kernel), manoeuvring, h, z[k], R, motion, P, *pruning)
        kernel.step(h, z[k], unexplained)
        np.testing.assert_allclose(kernel.imm["ended_probability"], ended, rtol=1e-4, atol=1e-8, err_msg=str(k))
        for got, wanted, name in zip(gaussians(kernel), expected, plain.NAMES, strict=True):
            assert got.weight == pytest.approx(wanted.weight, rel=1e-4, abs=1e-8), (k, name)
            if wanted.weight > 1e-6 and (
                kernel.mode_probability[HEALTHY] <= PRUNE_DOUBLES_ABOVE or plain.fault_count(name) < 2
            ):
                line = any(word in plain.LINES for word in name)
                n = 5 if line else 3
                np.testing.assert_allclose(got.mean[:n], wanted.mean[:n], rtol=1e-5, atol=1e-5, err_msg=f"{k} {name}")
                np.testing.assert_allclose(got.cov[:n, :n], wanted.cov[:n, :n], rtol=1e-4, atol=1e-6)


def test_mode_probabilities_sum_to_one_and_none_vanishes() -> None:
    t_s, z = readings(np.random.default_rng(1), "double")
    kernel = Kernel(*z[0])
    for k in range(1, len(t_s)):
        kernel.step(0.1, z[k])
        assert kernel.mode_probability.sum() == pytest.approx(1.0, abs=1e-8)
        assert kernel.mode_probability.min() >= 1e-10


@pytest.mark.parametrize("sensor", [0, 1])
def test_a_spike_is_attributed_to_its_sensor_and_to_nothing_after_it(sensor: int) -> None:
    t_s, z = readings(np.random.default_rng(2), "healthy")
    z[30, sensor] += 0.8
    kernel = Kernel(*z[0])
    for k in range(1, len(t_s)):
        kernel.step(0.1, z[k])
        fault_probability = sensor_fault_probability(kernel.mode_probability)
        if k == 30:
            assert fault_probability[sensor] > 0.95
            assert fault_probability[1 - sensor] < 0.05
        elif k > 32 or 5 < k < 30:
            assert kernel.mode_probability[HEALTHY] > 0.9


def test_the_end_of_a_bias_is_not_a_new_fault() -> None:
    t_s, z = readings(np.random.default_rng(3), "bias")
    kernel = Kernel(*z[0])
    for k in range(1, len(t_s)):
        kernel.step(0.1, z[k])
        if 21 <= k < 40:
            assert sensor_fault_probability(kernel.mode_probability)[0] > 0.99
        elif k > 41:
            assert kernel.mode_probability[HEALTHY] > 0.95


def test_the_innovation_is_that_of_the_healthy_mode() -> None:
    kernel = Kernel(0.0, 10.0)
    kernel.step(0.1, (1.2, 10.5))
    np.testing.assert_allclose(kernel.imm["nu"], (1.2 - 1.0, 0.5), atol=1e-12)
    assert kernel.imm["S"][2] == pytest.approx(R[1] + R[1] + 0.01 * P.a_std_mps2**2 + Q * 0.1**3 / 3.0, rel=1e-3)


@pytest.mark.parametrize("seed", [3, 4, 5])
def test_a_drift_that_went_unnoticed_is_recognised_as_it_ends(seed: int) -> None:
    """A location that wanders by a centimetre a reading hides it; what comes back is the truth, not a new fault."""
    rng = np.random.default_rng(seed)
    t_s, z = readings(rng, "healthy")
    z[:, 0] += np.cumsum(rng.normal(0.0, 0.01, len(t_s)))
    z[20:40, 1] -= np.linspace(0.0, 0.2, 20)
    row, imm = np.zeros(1, MODES)[0], np.zeros(1, IMM_WORKSPACE)[0]
    gentle = P._replace(manoeuvre_jerk_min=1.5)
    initialise_modes(row, *z[0], R, gentle)
    probabilities = []
    for k in range(1, len(t_s)):
        update(row, 0.1, z[k], R, Motion(0.03, 0.001, 0.003, 1.0, DEAD_ZONE_MPS), 0, gentle, imm)
        probabilities.append(sensor_fault_probability(row["mode_probability"])[1])
        if k == 40:
            assert imm["ended_probability"].argmax() == Mode.SPEED_DRIFT
            assert imm["ended_probability"].sum() > 0.9
    assert max(probabilities) < 0.1


def test_the_estimate_is_the_mixture_of_all_that_count() -> None:
    t_s, z = readings(np.random.default_rng(6), "double")
    kernel, into = Kernel(*z[0]), np.empty(SIZE)
    for k in range(1, len(t_s)):
        kernel.step(0.1, z[k])
        estimate(kernel.row, into)
        count = SINGLE_FAULT_MODES if kernel.mode_probability[HEALTHY] > PRUNE_DOUBLES_ABOVE else MODE_COUNT
        wanted = plain.mixed([part.healthy() for part in gaussians(kernel)[:count]])
        np.testing.assert_allclose(into[:3], wanted.mean[:3], rtol=1e-7)
        np.testing.assert_allclose(into[[5, 6, 7, 10, 11, 14]], wanted.cov[np.triu_indices(3)], rtol=1e-5)


def test_the_table_names_each_pair_of_faults_once() -> None:
    assert list(MODE_TABLE) == list(Mode)
    faults = [row.faults for row in MODE_TABLE.values()]
    assert len(set(faults)) == len(faults) == MODE_COUNT
    assert all(Fault.NONE in pair for pair in faults[:SINGLE_FAULT_MODES])
    assert not any(Fault.NONE in pair for pair in faults[SINGLE_FAULT_MODES:])


@pytest.mark.parametrize("mode", Mode)
def test_one_sensor_changes_at_a_time_and_its_shares_sum_to_one(mode: Mode) -> None:
    """For each sensor that begins or ends: the modes that follow divide its probability among them."""
    before, shares = MODE_TABLE[mode].faults, {0: 0.0, 1: 0.0}
    for target, share in MODE_TABLE[mode].next_shares.items():
        after = MODE_TABLE[target].faults
        changed = [z for z in (0, 1) if (before[z] is Fault.NONE) != (after[z] is Fault.NONE)]
        if len(changed) == 1:
            shares[changed[0]] += share
        else:
            assert (mode, target) == (Mode.HEALTHY, Mode.BOTH_NOISE)
    begins_or_ends = {z for z in (0, 1) if before[z] is Fault.NONE or Fault.NONE not in before}
    assert shares == {z: pytest.approx(1.0 if z in begins_or_ends else 0.0) for z in (0, 1)}
