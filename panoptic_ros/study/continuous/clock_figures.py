"""Figures of clocks and line delays that the continuous pass estimates."""

from __future__ import annotations

import numpy as np

from panoptic_ros.continuous.clocks import CameraTimes
from panoptic_ros.continuous.config import ContinuousConfig
from panoptic_ros.simulation.free_running import START_NS, FreeRunningCapture

Array = np.ndarray
UNKNOWNS = ("offset", "drift", "line")
TIME_KEYS = tuple(f"{name}_{key}" for name in UNKNOWNS for key in ("error", "z2", "known"))


def time_figures(
    capture: FreeRunningCapture, times: CameraTimes, reference_ns: int, config: ContinuousConfig
) -> dict[str, float]:
    """Return the figures `TIME_KEYS` of offsets (s), drifts and line delays (s per row); NaN = not asked.

    `error` is the RMS error of the values that are reported as observable, and `known` is their share. `z2`
    is the mean squared error in units of the stated standard deviations. The trusted camera does not count.

    Args:
        times: offsets hold at `reference_ns`.
    """
    middle = 1e-9 * (reference_ns - START_NS)
    truth = np.array(
        [
            [one.offset_s + one.drift * middle for one in capture.timings],
            [one.drift for one in capture.timings],
            [one.line_s for one in capture.timings],
        ]
    )
    counted = np.array([name != config.trusted_camera for name in capture.rig.names])
    found = dict.fromkeys(TIME_KEYS, np.nan)
    asked = (config.clocks, config.clocks, config.rolling_shutter)
    for row, name in enumerate(UNKNOWNS):
        if asked[row]:
            errors = (times.values[row] - truth[row])[counted]
            deviations, known = times.deviations[row, counted], times.observable[row, counted]
            stated = deviations > 0.0
            if known.any():
                found[f"{name}_error"] = float(np.sqrt(np.mean(errors[known] ** 2)))
            if stated.any():
                found[f"{name}_z2"] = float(np.mean((errors[stated] / deviations[stated]) ** 2))
            found[f"{name}_known"] = float(known.mean())
    return found
