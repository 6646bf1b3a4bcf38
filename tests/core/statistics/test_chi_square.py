"""Against scipy's quantiles."""

import numpy as np
import pytest
from scipy.special import chdtri

from headway.core.statistics.chi_square import gate_of_one, gate_of_two


@pytest.mark.parametrize("tail", np.geomspace(1e-15, 0.5, 12))
def test_the_gates_are_the_quantiles(tail: float) -> None:
    assert gate_of_one(tail) == pytest.approx(chdtri(1, tail), rel=1e-12)
    assert gate_of_two(tail) == pytest.approx(chdtri(2, tail), rel=1e-12)
