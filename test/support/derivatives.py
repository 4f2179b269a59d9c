"""Derivatives of lenses, by central differences."""

import numpy as np


def derivative(camera, plane, step=1e-6):
    """Derivative (..., 2, 2) of `Intrinsics.distort` at undistorted points (..., 2)."""
    columns = [
        (camera.distort(plane + step * e) - camera.distort(plane - step * e)) / (2 * step) for e in np.eye(2)
    ]
    return np.stack(columns, -1)
