"""Axes of bones are found whatever way round they are, and refused where they are those of no bone."""

from itertools import permutations, product

import numpy as np
import pytest
from bodies import MODEL, placed, some_pose

from panoptic_ros.errors import DataError
from panoptic_ros.geometry.rotations import rotations_of
from panoptic_ros.io.datasets.total_capture import bone_axes

WAYS = [
    way
    for axes in permutations(range(3))
    for signs in product((1.0, -1.0), repeat=3)
    if np.linalg.det(way := np.diag(signs)[list(axes)]) > 0.0
]


def moving(count=5):
    found = [placed(some_pose(k)) for k in range(count)]
    return np.array([places for _, places in found]), np.array([frames for frames, _ in found])


@pytest.mark.parametrize("way", WAYS)
def test_each_of_the_24_ways_is_found(way):
    places, frames = moving()
    toes = [MODEL.index(name) for name in ("lToe", "rToe")]
    places[:, toes], frames[:, toes] = np.nan, np.nan  # joints that the other skeleton lacks
    places[2, 5] = np.nan  # a sample that is missing
    np.testing.assert_array_equal(bone_axes(MODEL, places, frames @ way), way)


def test_orientations_that_are_of_no_bone_are_refused():
    places, frames = moving()
    rng = np.random.default_rng(1)
    turned = rotations_of(rng.uniform(-3.0, 3.0, (frames.shape[1], 3)))  # another way for each bone
    with pytest.raises(DataError, match="deg off where bones of our skeleton have them"):
        bone_axes(MODEL, places, frames @ turned)
    with pytest.raises(DataError, match="no two joints"):
        bone_axes(MODEL, np.full_like(places, np.nan), frames)
