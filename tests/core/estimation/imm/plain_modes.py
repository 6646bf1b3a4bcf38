"""The ten modes in plain NumPy: matrices and lists of Gaussians, written from the model, not from the kernel.

A mode is a pair of words for (position, speed), each one of healthy, bias, drift, noise, or line (an offset that was
bias or drift). What the mode table calls OFFSET is a line.
"""

from dataclasses import dataclass

import numpy as np
from scipy.stats import norm, t

HEALTHY = ("healthy", "healthy")
NAMES = [
    HEALTHY,
    ("bias", "healthy"),
    ("drift", "healthy"),
    ("noise", "healthy"),
    ("healthy", "bias"),
    ("healthy", "drift"),
    ("healthy", "noise"),
    ("line", "noise"),
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

    def healthy(self):
        keep = np.diag(MOTION)
        return Gaussian(self.weight, keep @ self.mean, keep @ self.cov @ keep)

    def times(self, factor):
        return Gaussian(self.weight * factor, self.mean.copy(), self.cov.copy())

    def with_offset(self, b_var, s_var):
        made = self.healthy()
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


def predicted(part, h, q, walk):
    F = np.eye(5)
    F[0, 1] = F[1, 2] = F[3, 4] = h
    F[0, 2] = h * h / 2.0
    Q = jerk_noise(h, q)
    Q[0, 0] += walk * h
    return Gaussian(part.weight, F @ part.mean, F @ part.cov @ F.T + Q)


def measured(part, sensor, faulty, z, r):
    H = np.zeros(5)
    H[sensor] = 1.0
    H[3] = float(faulty)
    S = H @ part.cov @ H + r
    K = part.cov @ H / S
    likelihood = norm.pdf(z, H @ part.mean, np.sqrt(S))
    I_KH = np.eye(5) - np.outer(K, H)
    cov = I_KH @ part.cov @ I_KH.T + r * np.outer(K, K)
    return Gaussian(part.weight * likelihood, part.mean + K * (z - H @ part.mean), cov)


def excluded(part, sensor, z, r, fault_size):
    scale = np.sqrt(part.cov[sensor, sensor] + r + fault_size**2)
    return part.times(t.pdf(z, 2, part.mean[sensor], scale))


def offset_set(part, sensor, z, r):
    """A diffuse offset in the limit of no prior knowledge: b = z - h, fully correlated with what is measured."""
    T = np.eye(5)
    T[3:] = 0.0
    T[3, sensor] = -1.0
    mean = part.mean.copy()
    mean[3:] = z - mean[sensor], 0.0
    cov = T @ part.cov @ T.T
    cov[3, 3] += r
    return Gaussian(part.weight, mean, cov)


def fault_count(name):
    return sum(word != "healthy" for word in name)


def updated(part, name, z, r, fault_size):
    """Update by speed, then position, each as its word in `name` says."""
    for sensor in (1, 0):
        if name[sensor] == "noise":
            part = excluded(part, sensor, z[sensor], r[sensor], fault_size)
        else:
            part = measured(part, sensor, name[sensor] in LINES, z[sensor], r[sensor])
    return part


def mixed_faults(before, fault, over, p):
    """The faulty modes before the reading, by the Markov chain without the ways between HEALTHY and single faults."""
    second, alone, last = (1 - over) * fault, over * (1 - over), (1 - over) ** 2
    after = {}

    def pair(sensor, this, that):
        return (this, that) if sensor == 0 else (that, this)

    for sensor in (0, 1):
        bias, drift = before[pair(sensor, "bias", "healthy")], before[pair(sensor, "drift", "healthy")]
        line, other_line = before[pair(sensor, "line", "noise")], before[pair(1 - sensor, "line", "noise")]
        noise, other_noise = before[pair(sensor, "noise", "healthy")], before[pair(1 - sensor, "noise", "healthy")]
        both, stay = before["noise", "noise"], (1 - over) * (1 - fault)
        after[pair(sensor, "bias", "healthy")] = [bias.times(stay)]
        after[pair(sensor, "drift", "healthy")] = [drift.times(stay), line.times(alone)]
        sources = [noise.times(stay), other_line.healthy().times(alone), both.times(alone)]
        after[pair(sensor, "noise", "healthy")] = sources
        fresh = other_noise.with_offset(2.0 * p.fault_size**2, p.drift_slope0**2)
        sources = [line.times(last), bias.times(second), drift.times(second), fresh.times(0.5 * second)]
        after[pair(sensor, "line", "noise")] = sources
    noises = [before["noise", "healthy"].times(0.5 * second), before["healthy", "noise"].times(0.5 * second)]
    after["noise", "noise"] = [before["noise", "noise"].times(last), before[HEALTHY].times(fault**2), *noises]
    return {name: mixed(sources) for name, sources in after.items()}


def onset(healthy, name, h, z, r, onset_probability, p):
    """A fault that begins at this reading, from the predicted HEALTHY."""
    sensor = 0 if name[0] != "healthy" else 1
    nu = z[sensor] - healthy.mean[sensor]
    part = Gaussian(onset_probability, healthy.mean.copy(), healthy.cov.copy())
    if "drift" in name:
        steep = p.drift_slope0**2 + p.drift_slope_share * (nu / h) ** 2
        return updated(part.with_offset(p.drift_offset0**2, steep), name, z, r, p.fault_size)
    without = updated(part, tuple("noise" if word != "healthy" else word for word in name), z, r, p.fault_size)
    return offset_set(without, sensor, z[sensor], r[sensor]) if "bias" in name else without


def step(parts, manoeuvring, h, z, r, motion, p, prune_doubles_above, prune_recovery_below_nis):
    """Return the modes after a reading `z` (2,) in the order of NAMES, and the probability that each has just ended.

    `manoeuvring` is the probability that the reading before belonged to a manoeuvre.
    """
    q, walk, unexplained = motion.jerk_density, motion.random_walk_density, motion.unexplained
    manoeuvre = unexplained * motion.manoeuvre
    more = q * (p.manoeuvre_jerk - 1.0) + unexplained * p.manoeuvre_jerk_min
    q_faulty = q + min(manoeuvring, manoeuvre) * more
    fault, over = min(0.1, p.faults_per_s * h), 1.0 - np.exp(-h / p.fault_s)
    before = dict(zip(NAMES, parts, strict=True))
    healthy = before[HEALTHY]
    doubles_pruned = healthy.weight > prune_doubles_above
    if doubles_pruned:
        prior = {name: before[name].times((1 - over) * (1 - fault)) for name in NAMES[1:] if fault_count(name) == 1}
    else:
        prior = mixed_faults(before, fault, over, p)
    prior[HEALTHY] = healthy.times(1.0 - 2.0 * fault)
    prior = {name: predicted(part, h, q if name == HEALTHY else q_faulty, walk) for name, part in prior.items()}
    for name, part in prior.items():
        if any(word in LINES for word in name):
            part.cov[3, 3] += p.offset_noise**2
    after = {name: updated(part, name, z, r, p.fault_size) for name, part in prior.items()}

    onset_probability = healthy.weight * fault / 3.0
    for name in NAMES[1:]:
        if fault_count(name) == 1:
            after[name] = mixed([after[name], onset(prior[HEALTHY], name, h, z, r, onset_probability, p)])
    manoeuvring = prior[HEALTHY].times(manoeuvre)
    jump = motion.dead_zone_mps**2 * np.exp(-0.5 * (manoeuvring.mean[1] / p.standstill_mps) ** 2)
    g = np.array([0.5 * h, 1.0, 0.0, 0.0, 0.0])
    manoeuvring.cov = manoeuvring.cov + jerk_noise(h, more) + jump * np.outer(g, g)
    manoeuvring.cov[2, 2] += jump / h
    sources = [after[HEALTHY].times(1.0 - manoeuvre), updated(manoeuvring, HEALTHY, z, r, p.fault_size)]

    nu = z - prior[HEALTHY].mean[:2]
    nis = nu @ np.linalg.solve(prior[HEALTHY].cov[:2, :2] + np.diag(r), nu)
    ended = np.zeros(len(NAMES))
    if not (doubles_pruned and nis < prune_recovery_below_nis):
        for k, name in enumerate(NAMES):
            if 0 < fault_count(name) <= (1 if doubles_pruned else 2):
                back = predicted(before[name].healthy().times(over ** fault_count(name)), h, q_faulty, walk)
                sources.append(updated(back, HEALTHY, z, r, p.fault_size))
                ended[k] = sources[-1].weight
    after[HEALTHY] = mixed(sources)
    if z[1] < -5.0 * np.sqrt(r[1]):
        for name in (HEALTHY, ("bias", "healthy"), ("drift", "healthy"), ("noise", "healthy")):
            after[name].weight *= 1e-8
    total = sum(part.weight for part in after.values())
    for name in NAMES:
        after.setdefault(name, Gaussian(0.0, after[HEALTHY].mean, after[HEALTHY].cov))
    return [Gaussian(max(after[n].weight / total, 1e-10), after[n].mean, after[n].cov) for n in NAMES], ended / total
