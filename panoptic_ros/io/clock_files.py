"""Read and write clocks and line delays of cameras, in the plain format `panoptic-clocks-1`."""

from __future__ import annotations

from pathlib import Path

from panoptic_ros.continuous.motion_result import ContinuousMotion
from panoptic_ros.io.files import write_json

FORMAT = "panoptic-clocks-1"


def write_camera_times(path: Path, motion: ContinuousMotion) -> None:
    """Write the clocks of a recording. Offsets hold at its first view: `reference_ns`."""
    since = 1e-9 * (motion.first_ns - motion.reference_ns)
    values, covariance = motion.clocks.values, motion.clocks.covariance
    count = len(motion.cameras)
    deviations = motion.clocks.deviations
    cameras = {}
    for c, name in enumerate(motion.cameras):
        offset, drift, line = values[:, c].tolist()
        variance = covariance[c, c] + 2.0 * since * covariance[c, count + c]
        variance += since * since * covariance[count + c, count + c]
        cameras[name] = {
            "offset_s": offset + since * drift,
            "offset_sd_s": float(max(variance, 0.0)) ** 0.5,
            "drift_ppm": 1e6 * drift,
            "drift_sd_ppm": 1e6 * float(deviations[1, c]),
            "line_delay_us": 1e6 * line,
            "line_delay_sd_us": 1e6 * float(deviations[2, c]),
        }
    write_json(path, {"format": FORMAT, "reference_ns": motion.first_ns, "cameras": cameras})
