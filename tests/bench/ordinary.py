"""What a user would otherwise write: the same filter, one object per pair, with the libraries there are.

Each is an extended Kalman filter of (x, v) behind a leader whose driver follows the Intelligent Driver Model, stepped
by Euler, with the squared innovation held against a gate: prediction, update and decision.
"""

from datetime import datetime, timedelta
from typing import Any

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter, IMMEstimator, KalmanFilter
from stonesoup.base import Property
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.transition.base import TransitionModel
from stonesoup.models.transition.nonlinear import GaussianTransitionModel
from stonesoup.predictor.kalman import ExtendedKalmanPredictor
from stonesoup.types.array import CovarianceMatrix, StateVector
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.state import GaussianState
from stonesoup.updater.kalman import ExtendedKalmanUpdater

from headway.core.estimation.car_following import IdmParams, idm

DT_S = 0.1
LENGTH_M = 4.7
GATE = 13.8
P = IdmParams()
Q, R = np.diag([0.05, 0.03]), np.diag([0.01, 0.01])
H = np.eye(2)
drive = idm.py_func
"""Plain Python, as its user would have it."""


def step(x_m: float, v_mps: float, leader: tuple[float, float]) -> tuple[float, float, float, float]:
    """Return the next x and v, and how the next v depends on x and on v."""
    f, df_dx, df_dv, _ = drive(leader[0] - x_m - LENGTH_M, v_mps, leader[1], P)
    return x_m + DT_S * v_mps, v_mps + DT_S * f, DT_S * df_dx, 1.0 + DT_S * df_dv


class FilterpyPair:
    """filterpy's extended Kalman filter."""

    def __init__(self, x_m: float, v_mps: float) -> None:
        self.ekf = ekf = ExtendedKalmanFilter(dim_x=2, dim_z=2)
        ekf.x, ekf.Q, ekf.R = np.array([x_m, v_mps]), Q, R

    def step(self, z: Any, leader: tuple[float, float]) -> bool:
        ekf = self.ekf
        x_m, v_mps, dv_dx, dv_dv = step(ekf.x[0], ekf.x[1], leader)
        ekf.F = np.array([[1.0, DT_S], [dv_dx, dv_dv]])
        ekf.x = np.array([x_m, v_mps])
        ekf.P = ekf.F @ ekf.P @ ekf.F.T + ekf.Q
        ekf.update(z, lambda _x: H, lambda x: x)
        return bool(ekf.y @ ekf.SI @ ekf.y > GATE)


class FilterpyTen:
    """filterpy's estimator of interacting models with ten of them, as many as the default model weighs."""

    def __init__(self, x_m: float, v_mps: float) -> None:
        filters = []
        for k in range(10):
            kf = KalmanFilter(dim_x=2, dim_z=2)
            kf.x, kf.F, kf.H = np.array([x_m, v_mps]), np.array([[1.0, DT_S], [0.0, 1.0]]), H
            kf.Q, kf.R = Q, R * 2.0**k
            filters.append(kf)
        stay = np.full((10, 10), 0.001) + 0.99 * np.eye(10)
        self.imm = IMMEstimator(filters, np.full(10, 0.1), stay / stay.sum(axis=1, keepdims=True))

    def step(self, z: Any, _leader: tuple[float, float]) -> bool:
        self.imm.predict()
        self.imm.update(z)
        return bool(self.imm.mu[0] < 1e-3)


class Following(GaussianTransitionModel, TransitionModel):
    """Car-following as a transition model of Stone Soup."""

    leader: tuple[float, float] = Property()

    @property
    def ndim_state(self) -> int:
        return 2

    def function(self, state: Any, **_: Any) -> StateVector:
        x_m, v_mps, _, _ = step(float(state.state_vector[0, 0]), float(state.state_vector[1, 0]), self.leader)
        return StateVector([x_m, v_mps])

    def jacobian(self, state: Any, **_: Any) -> Any:
        x_m, v_mps = float(state.state_vector[0, 0]), float(state.state_vector[1, 0])
        _, _, dv_dx, dv_dv = step(x_m, v_mps, self.leader)
        return np.array([[1.0, DT_S], [dv_dx, dv_dv]])

    def covar(self, **_: Any) -> CovarianceMatrix:
        return CovarianceMatrix(Q)


class StoneSoupPair:
    """Stone Soup's extended Kalman predictor and updater."""

    def __init__(self, x_m: float, v_mps: float) -> None:
        self._now = datetime(2026, 1, 1)  # noqa: DTZ001  Stone Soup's own examples know no zones
        self._state = GaussianState([x_m, v_mps], np.eye(2), timestamp=self._now)
        self._model = Following(leader=(0.0, 0.0))
        self._predictor = ExtendedKalmanPredictor(self._model)
        self._sensor = LinearGaussian(ndim_state=2, mapping=(0, 1), noise_covar=R)
        self._updater = ExtendedKalmanUpdater(self._sensor)

    def step(self, z: Any, leader: tuple[float, float]) -> bool:
        self._now += timedelta(seconds=DT_S)
        self._model.leader = leader
        prediction = self._predictor.predict(self._state, timestamp=self._now)
        detection = Detection(StateVector(z), timestamp=self._now, measurement_model=self._sensor)
        hypothesis = SingleHypothesis(prediction, detection)
        hypothesis.measurement_prediction = self._updater.predict_measurement(prediction)
        self._state = self._updater.update(hypothesis)
        nu = np.asarray(z) - np.asarray(hypothesis.measurement_prediction.state_vector).ravel()
        return bool(nu @ np.linalg.solve(np.asarray(hypothesis.measurement_prediction.covar), nu) > GATE)


class NumpyPairs:
    """All pairs at once in batched NumPy: the best that can be done without compiling."""

    def __init__(self, x_m: Any, v_mps: Any) -> None:
        self._s = np.stack([x_m, v_mps], axis=1)
        self._P = np.tile(np.eye(2), (len(x_m), 1, 1))

    def step(self, z: Any, leader_x_m: Any, leader_v_mps: Any) -> Any:
        x_m, v_mps = self._s.T
        d = np.maximum(leader_x_m - x_m - LENGTH_M, 0.5)
        free = (v_mps / P.v0_mps) ** P.delta
        c = 0.5 / np.sqrt(P.a_mps2 * P.b_mps2)
        s_star = P.s0_m + v_mps * P.T_s + v_mps * (v_mps - leader_v_mps) * c
        f = np.maximum(P.a_mps2 * (1.0 - free - (s_star / d) ** 2), -9.81)
        slope = 2.0 * P.a_mps2 * s_star / d**2
        F = np.empty((len(d), 2, 2))
        F[:, 0, 0], F[:, 0, 1] = 1.0, DT_S
        F[:, 1, 0] = -DT_S * slope * s_star / d
        F[:, 1, 1] = 1.0 + DT_S * (-4.0 * P.a_mps2 * free / v_mps - slope * (P.T_s + (2.0 * v_mps - leader_v_mps) * c))
        s = np.stack([x_m + DT_S * v_mps, v_mps + DT_S * f], axis=1)
        covariance = F @ self._P @ F.transpose(0, 2, 1) + Q
        inverse = np.linalg.inv(covariance + R)
        K, nu = covariance @ inverse, z - s
        self._s = s + (K @ nu[:, :, None])[:, :, 0]
        self._P = (np.eye(2) - K) @ covariance
        return np.einsum("ni,nij,nj->n", nu, inverse, nu) > GATE
