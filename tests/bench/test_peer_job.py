"""The job of the peers: its filter beside filterpy's, its messages beside ours."""

import json

import numpy as np
import pytest
from bench.peers.job import (
    ACCELERATION_VARIANCE,
    GATE,
    METRES_PER_DEGREE,
    POSITION_VARIANCE,
    SPEED_VARIANCE,
    Message,
    parse,
    step,
)
from edge.codec.messages import record
from filterpy.kalman import KalmanFilter


def test_its_filter_is_filterpys() -> None:
    rng = np.random.default_rng(1)
    state, _ = step(None, Message("a", 0, 0.0, 15.0))
    peer = KalmanFilter(dim_x=2, dim_z=2)
    peer.x, peer.H = np.array([0.0, 15.0]), np.eye(2)
    peer.P = peer.R = np.diag([POSITION_VARIANCE, SPEED_VARIANCE])
    last_us, alarms = 0, []
    for k in range(1, 60):
        t_us = last_us + int(rng.integers(50_000, 150_000))
        message = Message("a", t_us, 15e-6 * t_us + rng.normal() + 30.0 * (k == 40), 15.0 + 0.2 * rng.normal())
        dt = (t_us - last_us) / 1e6
        peer.F = np.array([[1.0, dt], [0.0, 1.0]])
        gain = np.array([[dt**2 / 2.0], [dt]])
        peer.predict(Q=ACCELERATION_VARIANCE * gain @ gain.T)
        peer.update(np.array([message.x_m, message.v_mps]))
        state, is_alarm = step(state, message)
        p_xx, p_xv, p_vv = state[3:]
        assert state[1:3] == pytest.approx(peer.x)
        assert np.array([[p_xx, p_xv], [p_xv, p_vv]]) == pytest.approx(peer.P)
        assert is_alarm == (peer.y @ peer.SI @ peer.y > GATE)
        alarms += [k] if is_alarm else []
        last_us = t_us
    assert 40 in alarms


def test_it_reads_a_record_of_bsm_v1() -> None:
    sent = record(lat=42.0, speed_mps=15.0)
    assert parse(json.dumps(sent)) == (sent[1], sent[3], 42.0 * METRES_PER_DEGREE, 15.0)
