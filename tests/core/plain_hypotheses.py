"""The ten hypotheses in plain NumPy: matrices and lists of Gaussians, written from the model, not from the kernel.

A hypothesis is a pair of words for (location, speed), each one of honest, bias, drift, noise, or line (an offset that
came from bias or drift); what the model calls PAIR is (line, noise) and (noise, line).
"""

from dataclasses import dataclass

import numpy as np
from scipy.stats import norm, t

HEALTHY = ("honest", "honest")
NAMES = [
    HEALTHY,
    ("bias", "honest"),
    ("drift", "honest"),
    ("noise", "honest"),
    ("line", "noise"),
    ("honest", "bias"),
    ("honest", "drift"),
    ("honest", "noise"),
    ("noise", "line"),
    ("noise", "noise"),
]
LINES = ("bias", "drift", "line")
MOTION = np.array([1.0, 1.0, 1.0, 0.0, 0.0])


@dataclass
class Gaussian:
    """Mean (5,) and covariance (5, 5) of [x, v, a, b, s], with its weight."""

    weight: float
    mean: np.ndarray
    cov: np.ndarray

    def honest(self):
        keep = np.diag(MOTION)
        return Gaussian(self.weight, keep @ self.mean, keep @ self.cov @ keep)

    def times(self, factor):
        return Gaussian(self.weight * factor, self.mean.copy(), self.cov.copy())

    def with_offset(self, b_var, s_var):
        made = self.honest()
        made.cov[3, 3], made.cov[4, 4] = b_var, s_var
        return made


def mixed(parts):
    total = sum(part.weight for part in parts)
    if total == 0.0:
        return parts[0]
    mean = sum(part.weight * part.mean for part in parts) / total
    cov = sum(part.weight * (part.cov + np.outer(part.mean - mean, part.mean - mean)) for part in parts) / total
    return Gaussian(total, mean, cov)


def jerk_noise(h, q):
    return q * np.array(
        [
            [h**5 / 20, h**4 / 8, h**3 / 6, 0, 0],
            [h**4 / 8, h**3 / 3, h**2 / 2, 0, 0],
            [h**3 / 6, h**2 / 2, h, 0, 0],
            [0, 0, 0, 0, 0],
            [0, 0, 0, 0, 0],
        ]
    )


def moved(part, h, q, walk):
    F = np.eye(5)
    F[0, 1] = F[1, 2] = F[3, 4] = h
    F[0, 2] = h * h / 2.0
    Q = jerk_noise(h, q)
    Q[0, 0] += walk * h
    return Gaussian(part.weight, F @ part.mean, F @ part.cov @ F.T + Q)


def seen(part, sensor, lying, z, r):
    H = np.zeros(5)
    H[sensor] = 1.0
    H[3] = float(lying)
    S = H @ part.cov @ H + r
    K = part.cov @ H / S
    likelihood = norm.pdf(z, H @ part.mean, np.sqrt(S))
    I_KH = np.eye(5) - np.outer(K, H)
    cov = I_KH @ part.cov @ I_KH.T + r * np.outer(K, K)
    return Gaussian(part.weight * likelihood, part.mean + K * (z - H @ part.mean), cov)


def unheeded(part, sensor, z, r, spread):
    scale = np.sqrt(part.cov[sensor, sensor] + r + spread**2)
    return part.times(t.pdf(z, 2, part.mean[sensor], scale))


def accused(part, sensor, z, r):
    """A diffuse offset in the limit of no prior knowledge: b = z - h, fully correlated with what is measured."""
    T = np.eye(5)
    T[3:] = 0.0
    T[3, sensor] = -1.0
    mean = part.mean.copy()
    mean[3:] = z - mean[sensor], 0.0
    cov = T @ part.cov @ T.T
    cov[3, 3] += r
    return Gaussian(part.weight, mean, cov)


def step(parts, h, z, r, q, walk, p):
    """Return what is thought after a reading `z` (2,): Gaussians in the order of NAMES, weights summing to 1."""
    fault, over = min(0.1, p.faults_per_s * h), 1.0 - np.exp(-h / p.fault_s)
    before = dict(zip(NAMES, parts, strict=True))
    after = {}
    healthy = before[HEALTHY]

    to_healthy = [healthy.times(1.0 - 2.0 * fault)]
    for name in NAMES[1:]:
        lying = sum(word != "honest" for word in name)
        to_healthy.append(before[name].honest().times(over**lying))
    healthy_prior = moved(mixed(to_healthy), h, q, walk)
    stay, second, alone = (1 - over) * (1 - fault), (1 - over) * fault, over * (1 - over)

    def pair(sensor, this, that):
        return (this, that) if sensor == 0 else (that, this)

    for sensor in (0, 1):
        other = 1 - sensor
        bias, drift = before[pair(sensor, "bias", "honest")], before[pair(sensor, "drift", "honest")]
        noise, line = before[pair(sensor, "noise", "honest")], before[pair(sensor, "line", "noise")]
        other_noise, other_line = before[pair(other, "noise", "honest")], before[pair(other, "line", "noise")]
        both = before["noise", "noise"]
        walked = np.zeros((5, 5))
        walked[3, 3] = p.offset_walk**2

        def predicted(sources, walked=walked):
            part = moved(mixed(sources), h, q, walk)
            part.cov = part.cov + walked
            return part

        without = seen(healthy_prior, other, False, z[other], r[other])
        without.weight *= healthy.weight * fault / 3.0 / healthy_prior.weight
        strange = unheeded(without, sensor, z[sensor], r[sensor], p.spread)

        kept = seen(predicted([bias.times(stay)]), other, False, z[other], r[other])
        kept = seen(kept, sensor, True, z[sensor], r[sensor])
        begun = accused(without, sensor, z[sensor], r[sensor])
        begun.weight = strange.weight
        after[pair(sensor, "bias", "honest")] = mixed([kept, begun])

        kept = seen(predicted([drift.times(stay), line.times(alone)]), other, False, z[other], r[other])
        kept = seen(kept, sensor, True, z[sensor], r[sensor])
        begun = seen(without.with_offset(p.drift_start**2, p.drift_slope**2), sensor, True, z[sensor], r[sensor])
        after[pair(sensor, "drift", "honest")] = mixed([kept, begun])

        sources = [noise.times(stay), other_line.honest().times(alone), both.times(alone)]
        kept = seen(moved(mixed(sources), h, q, walk), other, False, z[other], r[other])
        kept = unheeded(kept, sensor, z[sensor], r[sensor], p.spread)
        after[pair(sensor, "noise", "honest")] = mixed([kept, strange])

        fresh = other_noise.with_offset(2.0 * p.spread**2, p.drift_slope**2)
        sources = [line.times((1 - over) ** 2), bias.times(second), drift.times(second), fresh.times(0.5 * second)]
        kept = unheeded(predicted(sources), other, z[other], r[other], p.spread)
        after[pair(sensor, "line", "noise")] = seen(kept, sensor, True, z[sensor], r[sensor])

    noises = [before["noise", "honest"], before["honest", "noise"]]
    sources = [before["noise", "noise"].times((1 - over) ** 2), healthy.times(fault**2)]
    sources += [noise.times(0.5 * second) for noise in noises]
    both = moved(mixed(sources), h, q, walk)
    for sensor in (0, 1):
        weight = unheeded(both.times(1.0), sensor, z[sensor], r[sensor], p.spread).weight
        both.weight = weight
    after["noise", "noise"] = both

    calm = healthy_prior.times(1.0 - p.manoeuvre)
    lively = healthy_prior.times(p.manoeuvre)
    jump = p.standstill_jump_mps**2 * np.exp(-0.5 * (lively.mean[1] / p.standstill_mps) ** 2)
    g = np.array([0.5 * h, 1.0, 0.0, 0.0, 0.0])
    lively.cov = lively.cov + jerk_noise(h, q * (p.manoeuvre_jerk - 1.0) + p.manoeuvre_least) + jump * np.outer(g, g)
    lively.cov[2, 2] += jump / h
    for sensor in (1, 0):
        calm, lively = (seen(part, sensor, False, z[sensor], r[sensor]) for part in (calm, lively))
    after[HEALTHY] = mixed([calm, lively])
    if z[1] < -5.0 * np.sqrt(r[1]):
        for name in (HEALTHY, ("bias", "honest"), ("drift", "honest"), ("noise", "honest")):
            after[name].weight *= 1e-8
    total = sum(part.weight for part in after.values())
    return [Gaussian(max(after[n].weight / total, 1e-10), after[n].mean, after[n].cov) for n in NAMES]
