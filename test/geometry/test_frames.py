"""Frames of a tree, from anywhere to anywhere."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from panoptic_ros.errors import CalibrationError
from panoptic_ros.geometry import Rigid
from panoptic_ros.geometry.frames import FrameTree


def some(seed):
    rng = np.random.default_rng(seed)
    return Rigid(Rotation.random(random_state=seed).as_matrix(), rng.normal(size=3))


def test_a_point_is_the_same_whichever_way_it_goes():
    map_from_base, base_from_left, base_from_right = some(0), some(1), some(2)
    tree = FrameTree(
        {"base": ("map", map_from_base), "left": ("base", base_from_left), "right": ("base", base_from_right)}
    )
    point = np.array([0.3, 1.0, -2.0])
    np.testing.assert_allclose(
        tree.fixed_from("map", "left").apply(point), map_from_base.apply(base_from_left.apply(point))
    )
    np.testing.assert_allclose(
        base_from_right.apply(tree.fixed_from("right", "left").apply(point)), base_from_left.apply(point)
    )
    np.testing.assert_allclose(tree.fixed_from("base", "base").apply(point), point)
    assert tree.root("right") == "map" and tree.names == {"map", "base", "left", "right"}


def test_what_is_not_connected_is_told():
    tree = FrameTree({"left": ("map", some(0)), "right": ("odom", some(1))})
    with pytest.raises(CalibrationError, match="does not connect 'left' with 'odom': 'left' hangs on 'map'"):
        tree.fixed_from("odom", "left")
    with pytest.raises(CalibrationError, match="in a circle"):
        FrameTree({"a": ("b", some(0)), "b": ("a", some(1))}).root("a")
