"""The paper's filters in plain NumPy, written from the equations: whole histories, tiny steps, no limit on delta.

The past is what the buffers promise: estimates at the readings, and the predictions that divide a longer silence into
parts of at most 0.1 s, joined by straight lines; the running solution after the newest reading; constant speed before
the first.
"""

from dataclasses import dataclass, field

import numpy as np

IDM = {"a": 1.0, "b": 1.5, "delta": 4.0, "v0": 33.75, "s0": 2.0, "T": 1.0}
FLOOR = 1e-6
FINE = 20
"""Steps per part."""
PART_S = 0.1


def acceleration(x, v, u, length, idm=IDM):
    v = max(v, 0.0)
    free = 1.0 - (v / idm["v0"]) ** idm["delta"]
    if u is None:
        return idm["a"] * free
    gap = max(u[0] - x - length, 0.5)
    wanted = idm["s0"] + v * idm["T"] + v * (v - u[1]) / (2.0 * np.sqrt(idm["a"] * idm["b"]))
    return max(idm["a"] * (free - (wanted / gap) ** 2), -9.81)


def slope(f, at, step=1e-5):
    return (f(at + step) - f(at - step)) / (2.0 * step)


@dataclass
class Twin:
    """Model 1 with `order` 2, Model 2 with 3."""

    order: int
    delay_s: float
    gate: float
    jitter_s: float = 0.0
    idm: dict = field(default_factory=lambda: dict(IDM))
    times: list = field(default_factory=list)
    states: list = field(default_factory=list)
    covariances: list = field(default_factory=list)
    history: list = field(default_factory=list)
    length: float = 5.0

    def __post_init__(self):
        n = self.order
        self.H = np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 0.0]])[:, :n]
        self.Q = np.diag([0.5, 0.3, 1e-2])[:n, :n]
        self.R = 0.01 * np.eye(2)
        self.running = None

    def leader_at(self, t):
        """Location, speed and acceleration of the leader; None where there is none."""
        if not self.history:
            return None
        ts = [h[0] for h in self.history]
        k = int(np.searchsorted(ts, t, side="right"))
        if k in (0, len(ts)):
            t0, x, v = self.history[0 if k == 0 else -1]
            return x + v * (t - t0), v, 0.0
        (t0, x0, v0), (t1, x1, v1) = self.history[k - 1], self.history[k]
        w = (t - t0) / (t1 - t0)
        return x0 + w * (x1 - x0), v0 + w * (v1 - v0), (v1 - v0) / (t1 - t0)

    def own_at(self, t):
        if self.running and t > self.times[-1]:
            ts, ss, Ps = self.running
        else:
            ts, ss, Ps = self.times, self.states, self.covariances
        if t <= ts[0]:
            s = ss[0].copy()
            s[0] -= s[1] * (ts[0] - t)
            return s, Ps[0]
        k = min(int(np.searchsorted(ts, t, side="right")), len(ts) - 1)
        w = min(1.0, (t - ts[k - 1]) / (ts[k] - ts[k - 1]))
        return (1 - w) * ss[k - 1] + w * ss[k], (1 - w) * Ps[k - 1] + w * Ps[k]

    def derivatives(self, at, s, P):
        n = self.order
        u = self.leader_at(at)

        def f(x, v, lead):
            return acceleration(x, v, lead, self.length, self.idm)

        F = np.zeros((n, n))
        F[0, 1] = 1.0
        F[1, 0] = slope(lambda x: f(x, s[1], u), s[0])
        F[1, 1] = slope(lambda v: f(s[0], v, u), s[1])
        rate = np.zeros(n)
        rate[0], rate[1] = s[1], f(s[0], s[1], u)
        if n == 3:
            F[0, 2] = 1.0
            rate[0] += s[2]
        grown = F @ P + P @ F.T + self.Q
        if self.jitter_s and u is not None:
            x, v, a = u
            G = np.array([slope(lambda y: f(s[0], s[1], (y, v)), x), slope(lambda y: f(s[0], s[1], (x, y)), v)])
            grown[1, 1] += G @ (self.jitter_s**2 * np.array([[v * v, v * a], [v * a, a * a]])) @ G
        return rate, grown

    def predict(self, t):
        s, P = self.states[-1].copy(), self.covariances[-1].copy()
        now = self.times[-1]
        steps = FINE * int(np.ceil((t - now) / PART_S))
        h = (t - now) / steps
        self.running = ([now], [s], [P])
        for _ in range(steps):
            middle = now + 0.5 * h
            if self.delay_s:
                rate, grown = self.derivatives(middle - self.delay_s, *self.own_at(middle - self.delay_s))
            else:
                rate, grown = self.derivatives(now, s, P)
                rate, grown = self.derivatives(middle, s + 0.5 * h * rate, P + 0.5 * h * grown)
            s, P, now = s + h * rate, P + h * grown, now + h
            for series, value in zip(self.running, (now, s, P), strict=True):
                series.append(value)
        parts = max(1, int(np.ceil((t - self.times[-1]) / PART_S - 1e-6)))
        for at in np.linspace(self.times[-1], t, parts + 1)[1:-1]:
            k = int(np.argmin(np.abs(np.array(self.running[0]) - at)))
            self.remember(*(series[k] for series in self.running))
        self.running = None
        return s, lifted(P)

    def remember(self, t, s, P):
        for series, value in zip((self.times, self.states, self.covariances), (t, s, P), strict=True):
            series.append(value)

    def step(self, t, z, leader):
        """Update by a reading z = [x, v]; `leader` is (t, x, v) or None. Return (nis, anomalous, x, v) after it."""
        if leader is not None:
            self.history.append(leader)
        if not self.times:
            s, P, nis, anomalous = np.zeros(self.order), np.eye(self.order), 0.0, False
            s[:2] = z
        else:
            s, P = self.predict(t)
            nu = z - self.H @ s
            S = self.H @ P @ self.H.T + self.R
            nis = float(nu @ np.linalg.solve(S, nu))
            anomalous = nis > self.gate
            if not anomalous:
                K = P @ self.H.T @ np.linalg.inv(S)
                s = s + K @ nu
                P = lifted(P - K @ self.H @ P)
        self.remember(t, s, P)
        return nis, anomalous, *(self.H @ s)


def lifted(P):
    P = 0.5 * (P + P.T)
    values, vectors = np.linalg.eigh(P)
    if values[0] > FLOOR:
        return P
    return vectors @ np.diag(np.maximum(values, 2.0 * FLOOR)) @ vectors.T
