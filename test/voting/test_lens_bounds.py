import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from panoptic_ros.geometry import Intrinsics
from panoptic_ros.voting.lens_bounds import BINS, seen_radius, slope_bounds

LENSES = [
    ("brown", ()), ("brown", (-0.25, 0.06, 0.001, -0.002, 0.01)), ("brown", (-0.6,)),
    ("brown", (0.3, -0.1, 0.02, 0.03, 0.1)), ("fisheye", ()), ("fisheye", (-0.3,)),
    ("fisheye", (0.05, -0.02, 0.01, -0.004)),
]  # fmt: skip


@pytest.mark.parametrize("kind, lens", LENSES)
def test_no_slope_is_above_its_bound(kind, lens):
    intrinsics = Intrinsics(np.diag([500.0, 500.0, 1.0]), np.array(lens), kind)
    bounds, end = slope_bounds(intrinsics.lens, intrinsics.distortion, intrinsics.radius_limit)
    rng = np.random.default_rng(0)
    radius, angle = rng.uniform(0.0, end, 4000), rng.uniform(0.0, 2.0 * np.pi, 4000)
    plane = np.stack([np.cos(angle), np.sin(angle)], -1) * radius[:, None]
    slopes = np.abs(intrinsics.distort_jacobian(plane))
    mine = bounds[(radius / end * BINS).astype(int)]
    assert (slopes[:, [0, 1], [0, 1]] <= mine[:, :1] + 1e-12).all()
    assert (slopes[:, [0, 1], [1, 0]] <= mine[:, 1:] + 1e-12).all()
    if (kind, lens) == ("brown", ()):
        assert bounds == pytest.approx(np.tile([1.0, 0.0], (BINS, 1)))


@given(
    lens=st.tuples(*[st.floats(-limit, limit) for limit in (0.5, 0.2, 0.01, 0.01, 0.1)]),
    image_radius=st.floats(0.2, 3.0),
    angle=st.floats(0.0, 6.3),
)  # fmt: skip
def test_nothing_is_seen_beyond_the_seen_radius(lens, image_radius, angle):
    intrinsics = Intrinsics(np.diag([500.0, 500.0, 1.0]), np.array(lens))
    limit = intrinsics.radius_limit
    seen = seen_radius(intrinsics.lens, intrinsics.distortion, limit, image_radius)
    assert seen <= limit
    radius = np.geomspace(min(seen, 1e6), min(limit, 1e7), 2000)
    plane = radius[:, None] * (np.cos(angle), np.sin(angle))
    reached = np.linalg.norm(intrinsics.distort(plane), axis=-1)
    assert (reached[(radius > seen) & (radius < limit)] > image_radius).all()


@given(
    lens=st.tuples(*[st.floats(-limit, limit) for limit in (0.3, 0.1, 0.05, 0.02)]),
    image_radius=st.floats(0.2, 2.0),
)
def test_nothing_is_seen_beyond_the_seen_radius_of_a_fisheye(lens, image_radius):
    intrinsics = Intrinsics(np.diag([500.0, 500.0, 1.0]), np.array(lens), "fisheye")
    limit = intrinsics.radius_limit
    seen = seen_radius("fisheye", intrinsics.distortion, limit, image_radius)
    angles = np.linspace(0.0, np.arctan(limit), 2000)[1:-1]
    plane = np.stack([np.tan(angles), np.zeros_like(angles)], -1)
    reached = intrinsics.distort(plane)[:, 0]
    beyond = plane[:, 0] > seen
    assert (reached[beyond] > image_radius).all()
    assert not (reached[plane[:, 0] < 0.99 * seen] > image_radius).any()


@given(
    lens=st.tuples(*[st.floats(-limit, limit) for limit in (0.3, 0.1, 0.05, 0.02)]),
    seen=st.floats(0.1, 20.0),
)
def test_no_slope_of_any_fisheye_is_above_its_bound(lens, seen):
    intrinsics = Intrinsics(np.diag([500.0, 500.0, 1.0]), np.array(lens), "fisheye")
    bounds, end = slope_bounds("fisheye", intrinsics.distortion, seen)
    radius = np.linspace(0.0, end, 2000)[:-1]
    plane = np.array([0.6, 0.8]) * radius[:, None]
    slopes = np.abs(intrinsics.distort_jacobian(plane))
    mine = bounds[(radius / end * BINS).astype(int)]
    assert (slopes[:, [0, 1], [0, 1]] <= mine[:, :1] + 1e-12).all()
    assert (slopes[:, [0, 1], [1, 0]] <= mine[:, 1:] + 1e-12).all()


def test_the_seen_radius_is_where_the_image_ends():
    assert seen_radius("brown", np.zeros(5), np.inf, 0.7) == pytest.approx(0.7, rel=2e-3)
    barrel = Intrinsics(np.diag([500.0, 500.0, 1.0]), np.array([-0.126, 0.038]))
    end = np.linalg.norm(barrel.distort(np.array([1.0, 0.0])))
    assert seen_radius("brown", barrel.distortion, barrel.radius_limit, end) == pytest.approx(1.0, rel=2e-3)
    fold = Intrinsics(np.diag([500.0, 500.0, 1.0]), np.array([-0.6])).radius_limit
    assert seen_radius("brown", np.array([-0.6, 0.0, 0.0, 0.0, 0.0]), fold, 5.0) == fold
