"""What views see of a scene is what `VisibilityLimit.sees` says; which views are spread."""

from dataclasses import replace

import captures
import numpy as np
import pytest

from panoptic_ros.domain import DetectionSet, VisibilityLimit
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.geometry import Intrinsics
from panoptic_ros.solving.scene import HIDDEN, OUTSIDE, SEEN, gather, look, scene_of
from panoptic_ros.solving.triangulation import spread_views

LENS = (-0.2, 0.05, 0.001, -0.002, 0.01)


@pytest.mark.parametrize("distortion", [(), LENS])
def test_a_wall_with_a_hole_hides_the_same_as_in_the_image(distortion):
    cells = np.full((90, 160), 3000, np.uint16)
    cells[30:60, 40:120] = 0
    limit = VisibilityLimit(cells)
    lens = replace(captures.RIG.cameras[0].intrinsics, distortion=np.array(distortion))
    rig = replace(
        captures.RIG, cameras=(replace(captures.RIG.cameras[0], intrinsics=lens), *captures.RIG.cameras[1:])
    )
    views = captures.views(1)
    views = (replace(views[0], limit=limit), views[1])
    item = DetectionSet(0, views[0].stamp_ns, views[0].skeleton_hash, views)
    arrays = RigArrays.of(rig)
    evidence = gather(item, arrays, captures.SKELETON, captures.SKELETON.hash, 0.0)
    precision, mirror = np.ones(evidence.scores.shape), np.array(captures.SKELETON.mirror)
    sight = scene_of(item, evidence, precision, mirror, arrays).sight
    camera = rig.cameras[0]
    rng = np.random.default_rng(0)
    pixels = rng.uniform(0.0, [1279.0, 719.0], (3000, 2))
    plane, depths = camera.intrinsics.undistort(pixels), rng.uniform(1.0, 6.0, 3000)
    expected = limit.sees(pixels, depths, camera.image_size)
    found = np.array([look(sight, 0, *p, d) for p, d in zip(plane, depths)])
    assert 0.2 < expected.mean() < 0.8 and (found == np.where(expected, SEEN, HIDDEN)).all()
    assert look(sight, 1, 0.0, 0.0, 1e9) == SEEN and look(sight, 0, 9.0, 0.0, 1.0) == OUTSIDE
    assert isinstance(lens, Intrinsics)


def test_few_views_are_all_used_and_many_spread_farthest_first():
    centres = np.random.default_rng(3).normal(size=(40, 3))
    used = np.zeros(40, bool)
    used[2:38] = True
    assert np.array_equal(spread_views(centres, used, 36), used)
    picked = [2]
    while len(picked) < 24:
        gaps = np.linalg.norm(centres[2:38, None] - centres[picked], axis=-1).min(axis=1)
        picked.append(2 + int(gaps.argmax()))
    assert np.flatnonzero(spread_views(centres, used, 24)).tolist() == sorted(picked)
    assert spread_views(np.zeros((0, 3)), np.zeros(0, bool), 3).shape == (0,)
