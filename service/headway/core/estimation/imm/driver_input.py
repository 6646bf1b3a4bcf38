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
from headway.core.estimation.imm.noise_adaptation import bounded, tamed

LIKENESS_MOST = 2.0
UNFORESEEN_LEAST = 1e-3
"""Nobody is foreseen altogether: jerk and manoeuvres, which are scaled by what is not, must stay possible."""


class Driver(NamedTuple):
    """The model, and how its likeness is learnt."""

    idm: IdmParams
    delay_s: float
    change_most_mps2: float
    """Whatever changes what is asked by more at once is another car ahead: drivers get used to it bit by bit."""
    doubt: float
    """Information (inverse variance) that likeness is 0 before anything is heard,"""
    memory: float
    """and the share of all information that one reading leaves."""
    announced_step: float
    """Weight of the newest reading in how much is announced."""


def driver_dtype(delay_s: float) -> np.dtype[np.void]:
    """Return the record of one driver, whose ring reaches back `delay_s`."""
    return np.dtype(
        [
            *input_ring(delay_s),
            ("asked_mps2", "f8"),  # f_k at the newest reading; NaN: nobody ahead
            ("likeness", "f8"),
            ("information", "f8"),  # inverse variance of the likeness
            ("announced", "f8"),  # mean density of what the car ahead made to be expected, m^2/s^5, as that of jerk
            ("felt_mps", "f8"),  # derivative by likeness of the estimated speed,
            ("felt_mps2", "f8"),  # and of the acceleration
        ],
        align=True,
    )


@njit(cache=True)
def meet(driver: Any, p: Driver) -> None:
    """Begin with a driver's car; the likeness of one that is known stays known."""
    driver.information = max(driver.information, p.doubt)
    driver.input_count = 0
    driver.asked_mps2 = np.nan
    unfeel(driver)


@njit(cache=True)
def unfeel(driver: Any) -> None:
    """Say that the next innovation tells nothing of changes up to now."""
    driver.felt_mps, driver.felt_mps2 = 0.0, 0.0


@njit(cache=True)
def unforeseen_share(driver: Any, q: float) -> float:
    """Return the share that jerk of density `q` has in what changes the acceleration: the rest is announced."""
    return 1.0 if isnan(driver.asked_mps2) else max(UNFORESEEN_LEAST, float(q / (q + driver.announced)))


@njit(cache=True)
def ask(driver: Any, z: Any, dt_s: float, x_m: float, v_mps: float, p: Driver) -> float:
    """Return the change of acceleration to expect after a READING, at which the car is estimated to be at x, v."""
    if isnan(z.leader_t_s):
        driver.input_count = 0
        driver.asked_mps2 = np.nan
        return 0.0
    push_input(driver, z.leader_t_s, z.leader_x_m - z.leader_length_m, z.leader_v_mps)
    rear_x_m, leader_v_mps, _ = input_at(driver, z.t_s - p.delay_s)
    asked_mps2, _, _, _ = idm(rear_x_m - x_m, v_mps, leader_v_mps, p.idm)
    change = asked_mps2 - driver.asked_mps2
    driver.asked_mps2 = asked_mps2
    if not abs(change) <= p.change_most_mps2:
        driver.announced = 0.0
        return 0.0
    driver.felt_mps2 += change
    change *= driver.likeness
    if dt_s > 0.0:
        driver.announced += p.announced_step * (change**2 / dt_s - driver.announced)
    return float(change)


@njit(cache=True)
def learn_likeness(driver: Any, dt_s: float, nu: float, s: float, k_v: float, k_a: float, p: Driver) -> None:
    """Take the innovation `nu` of a healthy speed, of variance `s`, which moved v by k_v nu and a by k_a nu."""
    driver.felt_mps += dt_s * driver.felt_mps2
    felt_mps = driver.felt_mps
    kept = p.memory * driver.information + (1.0 - p.memory) * p.doubt
    driver.information = kept + felt_mps**2 / s
    step = felt_mps * tamed(nu, s) / (s * driver.information)
    driver.likeness = bounded(driver.likeness + step, 0.0, LIKENESS_MOST)
    driver.felt_mps -= k_v * felt_mps
    driver.felt_mps2 -= k_a * felt_mps
