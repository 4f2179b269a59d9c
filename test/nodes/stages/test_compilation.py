"""A node says once that it must compile."""

import numba
import numpy as np

from panoptic_ros.nodes.stages.stage_node import TEXT, Compilation


class Log:
    def __init__(self):
        self.texts = []

    def warning(self, text):
        self.texts.append(text)


def fresh_kernel(name):
    """A kernel, as if it were of this package, that no cache keeps."""

    def kernel(x):
        return x + 1.0

    kernel.__module__, kernel.__qualname__ = "panoptic_ros.nodes.stages.stage_node", name
    return numba.njit(kernel)


def test_compilation_is_told_once_in_the_log_and_while_it_goes_on():
    log, kernels, seen = Log(), [fresh_kernel("one"), fresh_kernel("two")], []
    times = iter([10.0, 10.5, 11.5])  # s, when kernels begin
    compilation = Compilation(log, lambda: seen.append(compilation.kernel), clock=lambda: next(times))
    assert [kernel(np.float64(1.0)) for kernel in kernels] == [2.0, 2.0]
    assert log.texts == [TEXT] and seen == ["nodes.stages.stage_node.one"]
    assert kernels[0](np.float64(1.0)) == 2.0
    assert compilation.kernel == "" and log.texts == [TEXT]
    fresh_kernel("four")(np.float64(1.0))
    assert seen == ["nodes.stages.stage_node.one", "nodes.stages.stage_node.four"] and log.texts == [TEXT]
    compilation.close()
    other = Log()
    fresh_kernel("three")(np.float64(1.0))
    assert log.texts == [TEXT] and len(seen) == 2 and not other.texts
