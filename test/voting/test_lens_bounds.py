import numpy as np
import pytest

from panoptic_ros.geometry import Intrinsics
from panoptic_ros.voting.lens_bounds import BINS, slope_bounds

LENSES = [(), (-0.25, 0.06, 0.001, -0.002, 0.01), (-0.6,), (0.3, -0.1, 0.02, 0.03, 0.1)]


@pytest.mark.parametrize("lens", LENSES)
def test_no_slope_is_above_its_bound(lens):
    intrinsics = Intrinsics(np.diag([500.0, 500.0, 1.0]), np.array(lens))
    bounds, end = slope_bounds(intrinsics.distortion, intrinsics.radius_limit)
    rng = np.random.default_rng(0)
    radius, angle = rng.uniform(0.0, end, 4000), rng.uniform(0.0, 2.0 * np.pi, 4000)
    plane = np.stack([np.cos(angle), np.sin(angle)], -1) * radius[:, None]
    slopes = np.abs(intrinsics.distort_jacobian(plane))
    mine = bounds[(radius / end * BINS).astype(int)]
    assert (slopes[:, [0, 1], [0, 1]] <= mine[:, :1] + 1e-12).all()
    assert (slopes[:, [0, 1], [1, 0]] <= mine[:, 1:] + 1e-12).all()
    if not lens:
        assert bounds == pytest.approx(np.tile([1.0, 0.0], (BINS, 1)))
