"""The ten hypotheses against their plain twin, and the behaviour they are there for."""

import numpy as np
import plain_hypotheses as plain
import pytest

from headway.core.config import DetectorConfig
from headway.core.hypotheses import COUNT, HEALTHY, SCRATCH, begin_all, judge, suspicion
from headway.core.imm import headway_params
from headway.core.motion import SIZE

P = headway_params(DetectorConfig()).hypotheses
R = np.array([1e-4, 1e-4])
Q, WALK = 0.2, 1e-5
TRIANGLE = np.triu_indices(5)


class Kernel:
    """M and w, with the room that `judge` wants."""

    def __init__(self, x_m, v_mps):
        self.M, self.w, self.out = np.zeros((COUNT, SIZE)), np.zeros(COUNT), np.zeros(5)
        begin_all(self.M, self.w, x_m, v_mps, *R, P)

    def step(self, h, z):
        judge(self.M, self.w, h, np.asarray(z), R, Q, WALK, P, np.empty(COUNT), np.empty((SCRATCH, SIZE)), self.out)


def gaussians(kernel):
    made = []
    for m, weight in zip(kernel.M, kernel.w, strict=True):
        cov = np.zeros((5, 5))
        cov[TRIANGLE] = m[5:]
        made.append(plain.Gaussian(float(weight), m[:5].copy(), cov + np.triu(cov, 1).T))
    return made


def readings(rng, kind, n=60):
    """A car that brakes gently, lied about from sample 20 to 40."""
    t_s = 0.1 * np.arange(n)
    x, v = 12.0 * t_s - 0.4 * t_s**2, 12.0 - 0.8 * t_s
    z = np.stack([x, v], axis=1) + rng.normal(0.0, 0.01, (n, 2))
    lie = slice(20, 40)
    if kind == "bias":
        z[lie, 0] += 0.7
    elif kind == "drift":
        z[lie, 1] += np.linspace(0.0, 0.8, 20)
    elif kind == "noise":
        z[lie, 1] += rng.normal(0.0, 1.0, 20)
    elif kind == "two":
        z[lie, 0] += 1.3
        z[25:45, 1] += rng.normal(0.0, 1.0, 20)
    elif kind == "negative":
        z[lie, 1] = -1.0
    return t_s, z


@pytest.mark.parametrize("kind", ["honest", "bias", "drift", "noise", "two", "negative"])
def test_every_step_agrees_with_the_plain_twin(kind: str) -> None:
    """From the same state each time, so that rounding does not add up where two hypotheses are neck and neck."""
    t_s, z = readings(np.random.default_rng(4), kind)
    came = np.arange(len(t_s)) % 7 != 5
    t_s, z = t_s[came], z[came]
    kernel = Kernel(*z[0])
    for k in range(1, len(t_s)):
        h = float(t_s[k] - t_s[k - 1])
        expected = plain.step(gaussians(kernel), h, z[k], R, Q, WALK, P)
        kernel.step(h, z[k])
        for got, wanted, name in zip(gaussians(kernel), expected, plain.NAMES, strict=True):
            assert got.weight == pytest.approx(wanted.weight, rel=1e-4, abs=1e-8), (k, name)
            if wanted.weight > 1e-6:
                line = any(word in plain.LINES for word in name)
                n = 5 if line else 3
                np.testing.assert_allclose(got.mean[:n], wanted.mean[:n], rtol=1e-5, atol=1e-5, err_msg=f"{k} {name}")
                np.testing.assert_allclose(got.cov[:n, :n], wanted.cov[:n, :n], rtol=1e-4, atol=1e-6)


def test_the_weights_sum_to_one_and_none_dies() -> None:
    t_s, z = readings(np.random.default_rng(1), "two")
    kernel = Kernel(*z[0])
    for k in range(1, len(t_s)):
        kernel.step(0.1, z[k])
        assert kernel.w.sum() == pytest.approx(1.0, abs=1e-8)
        assert kernel.w.min() >= 1e-10


@pytest.mark.parametrize("sensor", [0, 1])
def test_a_spike_is_blamed_on_its_sensor_and_on_nothing_after_it(sensor: int) -> None:
    t_s, z = readings(np.random.default_rng(2), "honest")
    z[30, sensor] += 0.8
    kernel = Kernel(*z[0])
    for k in range(1, len(t_s)):
        kernel.step(0.1, z[k])
        wrong = suspicion(kernel.w)
        if k == 30:
            assert wrong[sensor] > 0.95
            assert wrong[1 - sensor] < 0.05
        elif k > 32 or 5 < k < 30:
            assert kernel.w[HEALTHY] > 0.9


def test_the_end_of_a_bias_is_not_a_new_fault() -> None:
    t_s, z = readings(np.random.default_rng(3), "bias")
    kernel = Kernel(*z[0])
    for k in range(1, len(t_s)):
        kernel.step(0.1, z[k])
        if 21 <= k < 40:
            assert suspicion(kernel.w)[0] > 0.99
        elif k > 41:
            assert kernel.w[HEALTHY] > 0.95


def test_the_innovation_is_that_of_the_healthy_hypothesis() -> None:
    kernel = Kernel(0.0, 10.0)
    kernel.step(0.1, (1.2, 10.5))
    np.testing.assert_allclose(kernel.out[:2], (1.2 - 1.0, 0.5), atol=1e-12)
    assert kernel.out[4] == pytest.approx(R[1] + R[1] + 0.01 * P.a_std_mps2**2 + Q * 0.1**3 / 3.0, rel=1e-3)
