"""The car ahead as an input to the motion: what the driver model asks of a driver, as far as this one obeys it.

With f_k = f_v(u(t_k - tau), x_k, v_k), the acceleration that the Intelligent Driver Model (`car_following`) asks for at
reading k, given the leader of a delay ago and the car's own estimate,

    a(t_k) changes by likeness (f_k - f_{k-1})

beside what white jerk adds. Likeness is 1 for a driver who is the model, more for one who answers harder, 0 for one of
whom it says nothing. Only changes count: keeping another gap than the model is not unlike it.

The likeness is learnt by the recursive prediction error method (Ljung and Soderstrom 1983, Theory and Practice of
Recursive Identification): by how much the innovation of the speed would be another if it were another.
"""

from math import isnan
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from headway.core.estimation.car_following import IdmParams, idm
from headway.core.estimation.delay_buffers import input_at, input_ring, push_input
from headway.core.estimation.imm.noise_adaptation import clip, clip_innovation

RESPONSE_GAIN_MAX = 2.0
UNEXPLAINED_SHARE_MIN = 1e-3
"""Nobody is foreseen altogether: jerk and manoeuvres, which are scaled by what is not, must stay possible."""


class DriverParams(NamedTuple):
    """The model, and how its likeness is learnt."""

    idm: IdmParams
    delay_s: float
    accel_change_max_mps2: float
    """Whatever changes what is asked by more at once is another car ahead: drivers get used to it bit by bit."""
    prior_information: float
    """Information (inverse variance) that likeness is 0 before anything is heard,"""
    forgetting_factor: float
    """and the share of all information that one reading leaves."""
    explained_step: float
    """Weight of the newest reading in how much is announced."""


def driver_dtype(delay_s: float) -> np.dtype[np.void]:
    """Return the record of one driver, whose ring reaches back `delay_s`."""
    return np.dtype(
        [
            *input_ring(delay_s),
            ("idm_accel_mps2", "f8"),  # f_k at the newest reading; NaN: nobody ahead
            ("response_gain", "f8"),
            ("information", "f8"),  # inverse variance of the likeness
            (
                "explained_density",
                "f8",
            ),  # mean density of what the car ahead made to be expected, m^2/s^5, as that of jerk
            ("speed_sensitivity", "f8"),  # derivative by likeness of the estimated speed,
            ("accel_sensitivity", "f8"),  # and of the acceleration
        ],
        align=True,
    )


@njit(cache=True, error_model="numpy")
def set_leader(driver: Any, p: DriverParams) -> None:
    """Begin with a driver's car; the likeness of one that is known stays known."""
    driver.information = max(driver.information, p.prior_information)
    driver.input_count = 0
    driver.idm_accel_mps2 = np.nan
    reset_sensitivity(driver)


@njit(cache=True, error_model="numpy")
def reset_sensitivity(driver: Any) -> None:
    """Say that the next innovation tells nothing of changes up to now."""
    driver.speed_sensitivity, driver.accel_sensitivity = 0.0, 0.0


@njit(cache=True, error_model="numpy")
def unexplained_share(driver: Any, q: float) -> float:
    """Return the share of jerk of density `q` in the changes of acceleration; the rest is explained by the leader."""
    return (
        1.0 if isnan(driver.idm_accel_mps2) else max(UNEXPLAINED_SHARE_MIN, float(q / (q + driver.explained_density)))
    )


@njit(cache=True, error_model="numpy")
def predict_acceleration(driver: Any, z: Any, dt_s: float, x_m: float, v_mps: float, p: DriverParams) -> float:
    """Return the change of acceleration to expect after a READING, at which the car is estimated to be at x, v."""
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
    """Take the innovation `nu` of a healthy speed, of variance `s`, which moved v by k_v nu and a by k_a nu."""
    driver.speed_sensitivity += dt_s * driver.accel_sensitivity
    speed_sensitivity = driver.speed_sensitivity
    kept = p.forgetting_factor * driver.information + (1.0 - p.forgetting_factor) * p.prior_information
    driver.information = kept + speed_sensitivity**2 / s
    step = speed_sensitivity * clip_innovation(nu, s) / (s * driver.information)
    driver.response_gain = clip(driver.response_gain + step, 0.0, RESPONSE_GAIN_MAX)
    driver.speed_sensitivity -= k_v * speed_sensitivity
    driver.accel_sensitivity -= k_a * speed_sensitivity
