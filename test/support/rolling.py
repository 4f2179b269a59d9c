"""2D joints in images whose rows are exposed one after the other."""

from dataclasses import replace

import numpy as np

ROUNDS = 6  # iterations; each one leaves about 1/20 of the error


def with_line_delays(rig, line_delays_us):
    """A rig whose cameras have these line delays, in turn."""
    delays = [line_delays_us[k % len(line_delays_us)] for k in range(len(rig))]
    cameras = [replace(camera, line_delay_us=delay) for camera, delay in zip(rig.cameras, delays)]
    return replace(rig, cameras=tuple(cameras))


def rolling_points(camera, joints_at, stamp_s):
    """Pixels (P, J, 2) of people in an image whose first row is exposed at a time in s.

    Args:
        joints_at: gives the joints (P, J, 3) m at a time in s.
    """
    rows = np.zeros(joints_at(stamp_s).shape[:2])
    for _ in range(ROUNDS if camera.line_delay_us else 1):
        times = stamp_s + 1e-6 * camera.line_delay_us * rows
        places = [[joints_at(t)[p, j] for j, t in enumerate(own)] for p, own in enumerate(times)]
        points, _ = camera.project(np.array(places))
        rows = points[..., 1]
    return points
