"""A node says once that it must compile."""
import numba
import numpy as np

from panoptic_ros.nodes.compilation import TEXT, compilation_told


class Log:
    def __init__(self):
        self.texts = []

    def warning(self, text):
        self.texts.append(text)


def fresh_kernel(name):
    """A kernel, as if it were of this package, that no cache keeps."""

    def kernel(x):
        return x + 1.0

    kernel.__module__, kernel.__qualname__ = "panoptic_ros.nodes.compilation", name
    return numba.njit(kernel)


def test_compilation_is_told_once_and_ready_kernels_are_not():
    log, kernels = Log(), [fresh_kernel("one"), fresh_kernel("two")]
    with compilation_told(log):
        assert [kernel(np.float64(1.0)) for kernel in kernels] == [2.0, 2.0]
    assert log.texts == [TEXT]
    with compilation_told(log):
        assert kernels[0](np.float64(1.0)) == 2.0
    assert log.texts == [TEXT]
    fresh_kernel("three")(np.float64(1.0))
    assert log.texts == [TEXT]
