import numpy as np
import pytest
from numba import njit

from headway.core.runtime.bound_kernel import bind_signature


@njit
def total(values: np.ndarray) -> float:
    return values.sum()


def test_a_bound_kernel_computes_what_the_kernel_computes() -> None:
    bound = bind_signature(total)
    assert [bound(np.arange(float(n))) for n in (0, 3, 5)] == [0.0, 3.0, 10.0]


@pytest.mark.parametrize(
    "other",
    [np.arange(4), np.arange(4.0, dtype=np.float32), np.arange(8.0)[::2], np.ones((2, 2))],
    ids=["integers", "precision", "strides", "dimensions"],
)
def test_a_bound_kernel_refuses_arguments_of_another_type_or_layout(other: np.ndarray) -> None:
    bound = bind_signature(total)
    bound(np.arange(4.0))
    with pytest.raises(TypeError, match="total is bound to"):
        bound(other)
