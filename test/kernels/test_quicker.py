"""What is left out of kernels so that they compile quicker changes no result."""

import numpy as np
import pytest

from panoptic_ros.kernels import njit
from panoptic_ros.kernels.quicker import quicker


@njit(error_model="numpy")
def _put(target: np.ndarray, source: np.ndarray) -> None:
    target[1:] = source


def test_an_array_of_another_shape_is_refused_and_one_that_fits_is_copied():
    target = np.zeros(4)
    _put(target, np.arange(3.0))
    assert target.tolist() == [0.0, 0.0, 1.0, 2.0]
    with pytest.raises(ValueError, match="another shape"):
        _put(target, np.arange(2.0))
    assert target.tolist() == [0.0, 0.0, 1.0, 2.0]


def test_numba_is_as_before_afterwards():
    from numba.np import arrayobj

    before = arrayobj.raise_with_shape_context
    with quicker():
        assert arrayobj.raise_with_shape_context is not before
    assert arrayobj.raise_with_shape_context is before
