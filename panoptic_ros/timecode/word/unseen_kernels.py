"""Parts of a word's wave that its samples do not show: sudden level changes, phases between samples."""

from __future__ import annotations

import numpy as np

from panoptic_ros.kernels import njit

Array = np.ndarray
_jit = njit(cache=True, error_model="numpy", nogil=True)


@_jit
def jumps(values: Array, level: float) -> float:
    """Share of the changes of sign of samples (N,) that lie between two samples of level plateaus."""
    crossings, sudden = 0, 0
    for i in range(1, len(values) - 2):
        if (values[i] > 0.0) == (values[i + 1] > 0.0):
            continue
        crossings += 1
        if abs(values[i + 1] - values[i]) > 1.6 * level:
            flat = max(abs(values[i] - values[i - 1]), abs(values[i + 2] - values[i + 1]))
            sudden += int(flat < 0.06 * level)
    return sudden / max(1, crossings)


@_jit
def widest_gap(places: Array, period: float) -> float:
    """Within a period, the widest gap between places (N,)."""
    phases = np.empty(len(places))
    for i in range(len(places)):
        phase, k = places[i] % period, i
        while k > 0 and phases[k - 1] > phase:
            phases[k] = phases[k - 1]
            k -= 1
        phases[k] = phase
    widest: float = phases[0] + period - phases[-1]
    for i in range(1, len(phases)):
        widest = max(widest, phases[i] - phases[i - 1])
    return widest
