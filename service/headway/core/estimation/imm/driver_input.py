"""The leader as an input of the motion: the acceleration that the driver model predicts, times the driver's own gain.

Let f_k = f_v(u(t_k - tau), x_k, v_k) be the acceleration of the Intelligent Driver Model (`car_following`) at reading
k, from the leader a delay ago and the vehicle's own estimate. In addition to white jerk,

    a changes by g (f_k - f_{k-1})

The response gain g is 1 for a driver who is the model, more for a stronger response, and 0 for a driver of whom the
model says nothing. Only changes count, so a driver who keeps another gap than the model has the same gain.

The gain is adapted by the recursive prediction error method (Ljung and Soderstrom 1983, Theory and Practice of
Recursive Identification, section 3.3), with psi = dv/dg the sensitivity of the predicted speed and nu its innovation:

    R <- lambda R + (1 - lambda) R_0 + psi^2 / S        g <- g + psi nu / (S R)
"""

from math import isnan
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from headway.core.estimation.car_following import IdmParams, idm
from headway.core.estimation.delay_buffers import input_at, input_ring, push_input
from headway.core.estimation.imm.noise_adaptation import clip, clip_innovation

RESPONSE_GAIN_MAX = 2.0
"""Real drivers have 0.1 to 0.7, the published follower 1 (ADR 0005, "The car ahead is an input")."""
UNEXPLAINED_SHARE_MIN = 1e-3
"""Jerk and manoeuvres scale with the unexplained share and must stay possible."""


class DriverParams(NamedTuple):
    """The driver model and how its gain is adapted. Values without another source: tuned on the pairs, ADR 0005."""

    idm: IdmParams
    delay_s: float
    """tau, s."""
    accel_change_max_mps2: float = 1.0
    """A larger change of f_v at once means another leader, to which drivers respond gradually (ADR 0005)."""
    prior_information: float = 60.0
    """R_0: inverse variance of the prior gain 0."""
    forgetting_factor: float = 0.9995
    """lambda: share of the information that is kept at a reading; a memory of 200 s at 10 Hz."""
    explained_step: float = 0.002
    """Weight of the newest reading in the mean explained density; a memory of 50 s at 10 Hz."""


def driver_dtype(delay_s: float) -> np.dtype[np.void]:
    """Return the record of one driver, whose ring of inputs reaches back `delay_s`."""
    return np.dtype(
        [
            *input_ring(delay_s),
            ("idm_accel_mps2", "f8"),  # f_k at the newest reading; NaN: no leader
            ("response_gain", "f8"),  # g
            ("information", "f8"),  # R: inverse variance of the gain
            ("explained_density", "f8"),  # density of the changes of acceleration that the leader explains, m^2/s^5
            ("speed_sensitivity", "f8"),  # psi: derivative of the predicted speed by g, m/s
            ("accel_sensitivity", "f8"),  # derivative of the acceleration by g, m/s^2
        ],
        align=True,
    )


@njit(cache=True, error_model="numpy")
def initialise_driver(driver: Any, p: DriverParams) -> None:
    """Initialise a driver without a leader; a gain that is known is kept."""
    driver.information = max(driver.information, p.prior_information)
    driver.input_count = 0
    driver.idm_accel_mps2 = np.nan
    reset_sensitivity(driver)


@njit(cache=True, error_model="numpy")
def reset_sensitivity(driver: Any) -> None:
    """Set the sensitivities to 0: the next innovation does not depend on earlier inputs."""
    driver.speed_sensitivity, driver.accel_sensitivity = 0.0, 0.0


@njit(cache=True, error_model="numpy")
def unexplained_share(driver: Any, q: float) -> float:
    """Return the share of jerk of density `q` in the changes of acceleration; the leader explains the rest."""
    return (
        1.0 if isnan(driver.idm_accel_mps2) else max(UNEXPLAINED_SHARE_MIN, float(q / (q + driver.explained_density)))
    )


@njit(cache=True, error_model="numpy")
def predict_acceleration(driver: Any, z: Any, dt_s: float, x_m: float, v_mps: float, p: DriverParams) -> float:
    """Return g (f_k - f_{k-1}), m/s^2, after a READING at which position and speed are estimated as x, v."""
    if isnan(z.leader_t_s):
        driver.input_count = 0
        driver.idm_accel_mps2 = np.nan
        return 0.0
    push_input(driver, z.leader_t_s, z.leader_x_m - z.leader_length_m, z.leader_v_mps)
    rear_x_m, leader_v_mps, _ = input_at(driver, z.t_s - p.delay_s)
    idm_accel_mps2, _, _, _ = idm(rear_x_m - x_m, v_mps, leader_v_mps, p.idm)
    change = idm_accel_mps2 - driver.idm_accel_mps2
    driver.idm_accel_mps2 = idm_accel_mps2
    if not abs(change) <= p.accel_change_max_mps2:
        driver.explained_density = 0.0
        return 0.0
    driver.accel_sensitivity += change
    change *= driver.response_gain
    if dt_s > 0.0:
        driver.explained_density += p.explained_step * (change**2 / dt_s - driver.explained_density)
    return float(change)


@njit(cache=True, error_model="numpy")
def adapt_response_gain(driver: Any, dt_s: float, nu: float, s: float, k_v: float, k_a: float, p: DriverParams) -> None:
    """Adapt g to the innovation `nu` of a healthy speed, of variance `s`; `k_v`, `k_a` are the Kalman gains of v, a."""
    driver.speed_sensitivity += dt_s * driver.accel_sensitivity
    psi = driver.speed_sensitivity
    kept = p.forgetting_factor * driver.information + (1.0 - p.forgetting_factor) * p.prior_information
    driver.information = kept + psi**2 / s
    step = psi * clip_innovation(nu, s) / (s * driver.information)
    driver.response_gain = clip(driver.response_gain + step, 0.0, RESPONSE_GAIN_MAX)
    driver.speed_sensitivity -= k_v * psi
    driver.accel_sensitivity -= k_a * psi
