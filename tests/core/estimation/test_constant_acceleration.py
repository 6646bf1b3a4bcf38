"""The baseline: an ordinary Kalman filter, against filterpy."""

import numpy as np
from core.driving import drive
from filterpy.kalman import KalmanFilter

from headway.core.estimation.constant_acceleration import CA, ca_params, step_row
from headway.core.runtime.rows import verdicts
from headway.core.types.config import DetectorConfig
from headway.core.types.records import Sensor


def run(read, **changes):
    bank, results = np.zeros(1, CA), verdicts(len(read))
    p = ca_params(DetectorConfig())._replace(**changes)
    for z, verdict in zip(read, results, strict=True):
        step_row(bank[0], z, p, verdict)
    return results


def test_estimates_and_innovations_are_those_of_filterpy() -> None:
    read, _, _ = drive(np.random.default_rng(0), n=80)
    p = ca_params(DetectorConfig())
    results = run(read, gate=np.inf)
    h = 0.1
    kf = KalmanFilter(dim_x=3, dim_z=2)
    kf.x = np.array([read["x_m"][0], read["v_mps"][0], 0.0])
    kf.P, kf.R, kf.H = np.diag([p.r_x, p.r_v, p.a_var]), np.diag([p.r_x, p.r_v]), np.eye(2, 3)
    kf.F = np.array([[1.0, h, h * h / 2.0], [0.0, 1.0, h], [0.0, 0.0, 1.0]])
    kf.Q = p.jerk * np.array([[h**5 / 20, h**4 / 8, h**3 / 6], [h**4 / 8, h**3 / 3, h**2 / 2], [h**3 / 6, h**2 / 2, h]])
    for k in range(1, len(read)):
        kf.predict()
        kf.update(np.array([read["x_m"][k], read["v_mps"][k]]))
        np.testing.assert_allclose(results["nu"][k], kf.y, rtol=1e-7, atol=1e-9)
        np.testing.assert_allclose(results["S"][k], kf.S, rtol=1e-7)
        np.testing.assert_allclose(results["nis"][k], kf.y @ np.linalg.solve(kf.S, kf.y), rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose((results["x_m"][k], results["v_mps"][k]), kf.x[:2], rtol=1e-9)


def test_a_spike_is_rejected_whole_and_named() -> None:
    read, x, _ = drive(np.random.default_rng(1), n=200)
    read["x_m"][100] += 2.0
    results = run(read)
    np.testing.assert_array_equal(np.flatnonzero(results["anomalous"]), [100])
    assert results["sensor"][100] == Sensor.LOCATION
    assert abs(results["x_m"][100] - x[100]) < 0.1


def test_it_is_initialised_again_after_too_many_rejections() -> None:
    read, _, _ = drive(np.random.default_rng(2), n=200)
    read["x_m"][100:] += 50.0
    results = run(read, rejections_max=10)
    np.testing.assert_array_equal(np.flatnonzero(results["restarted"]), [109])
    assert not results["anomalous"][110:].any()
