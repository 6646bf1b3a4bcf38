"""Kinds distinguished by their shape, from the generators of Algorithm 1."""

from collections.abc import Callable

import numpy as np
import pytest

from headway.core.statistics.fault_shape import EPISODE, add_deviation, end_episode, likeliest_kind
from headway.core.types.records import Kind

R = 0.01


def named_kind(deviations: np.ndarray) -> tuple[Kind, float]:
    [episode] = np.zeros(1, EPISODE)
    for e in deviations:
        add_deviation(episode, e)
    kind, confidence = likeliest_kind(episode, R)
    return Kind(kind), confidence


def test_one_reading_is_short() -> None:
    assert named_kind(np.array([3.0])) == (Kind.SHORT, 1.0)


@pytest.mark.parametrize(
    ("kind", "shape"),
    [
        (Kind.NOISE, lambda rng, n: rng.normal(0, 1, n)),
        (Kind.BIAS, lambda _, n: np.full(n, 1.5)),
        (Kind.DRIFT, lambda _, n: np.linspace(0.1, 2.0, n)),
    ],
)
def test_the_shape_names_the_kind(kind: Kind, shape: Callable[[np.random.Generator, int], np.ndarray]) -> None:
    rng = np.random.default_rng(3)
    named = [named_kind(shape(rng, 15) + rng.normal(0, R**0.5, 15))[0] for _ in range(100)]
    assert named.count(kind) >= 80


def test_confidence_grows_with_the_readings() -> None:
    ramp = np.linspace(0.2, 4.0, 20)
    few, many = named_kind(ramp[:3])[1], named_kind(ramp)[1]
    assert 1 / 3 < few < many <= 1.0


def test_an_episode_that_has_ended_starts_again() -> None:
    [episode] = np.zeros(1, EPISODE)
    add_deviation(episode, 1.0)
    add_deviation(episode, 2.0)
    end_episode(episode)
    add_deviation(episode, 5.0)
    assert likeliest_kind(episode, R) == (Kind.SHORT, 1.0)
