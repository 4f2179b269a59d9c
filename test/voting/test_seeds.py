import numpy as np
import pytest

from panoptic_ros.geometry import Intrinsics
from panoptic_ros.voting.peaks import KnownNodes, find_peaks
from panoptic_ros.voting.proposals import NodeCriteria
from panoptic_ros.voting.scene import build_scene
from panoptic_ros.voting.seeds import pixel_rays, seeds

WANTED = NodeCriteria(0.1, 3, 0.1)
LENS = (-0.2, 0.05, 0.001, -0.002, 0.01)
FISHEYE = Intrinsics(np.eye(3), (0.02, -0.01, 0.003, -0.001), "fisheye")


@pytest.mark.parametrize("lens", [(), LENS, FISHEYE])
def test_rays_are_those_of_the_cameras(scenes, lens):
    rig = scenes.ring(3, lens)
    scene = build_scene(rig.cameras, scenes.detect(rig, []).views, 19)
    rng = np.random.default_rng(0)
    pixels, views = rng.uniform((0, 0), (640, 480), (60, 2)), np.arange(60) % 3
    rays = pixel_rays(scene.cameras, views, pixels)
    for v, camera in enumerate(rig.cameras):
        assert rays[views == v] == pytest.approx(camera.rays(pixels[views == v]), abs=1e-9)


def test_a_pixel_beyond_the_fold_of_a_lens_has_no_ray(scenes):
    rig = scenes.ring(1, (-0.5,))
    scene = build_scene(rig.cameras, scenes.detect(rig, []).views, 19)
    pixels = np.array([[320.0, 240.0], [3000.0, 240.0]])
    rays = pixel_rays(scene.cameras, np.zeros(2, int), pixels)
    assert np.isfinite(rays).all(1).tolist() == [True, False]


@pytest.mark.parametrize("maps, lens", [("none", LENS), ("merged", LENS), ("merged", FISHEYE)])
def test_there_is_a_seed_at_every_joint(scenes, maps, lens):
    rig = scenes.ring(4, lens)
    people = np.stack([scenes.person(0.4, 0.3), scenes.person(-0.3, -0.4, 2.0)])
    scene = build_scene(rig.cameras, scenes.detect(rig, people, maps).views, 19)
    joints, points = seeds(scene, WANTED, KnownNodes.of_nobody(np.zeros(len(rig))))
    for j in range(19):
        for person in people:
            assert np.linalg.norm(points[joints == j] - person[j], axis=1).min() < 0.02


def test_rays_that_meet_give_one_seed(scenes):
    rig = scenes.ring(6, LENS)
    scene = build_scene(rig.cameras, scenes.detect(rig, [scenes.person(0.1, 0.2)]).views, 19)
    joints, _ = seeds(scene, WANTED, KnownNodes.of_nobody(np.zeros(len(rig))))
    assert joints.tolist() == list(range(19))


def test_keypoints_are_the_peaks_of_joints_without_maps(scenes):
    rig = scenes.ring(2)
    item = scenes.detect(rig, [scenes.person(0.0, 0.0), scenes.person(0.5, 0.5)])
    start, pixels = find_peaks(build_scene(rig.cameras, item.views, 19), 0.1)
    for v, view in enumerate(item.views):
        for j in range(19):
            mine = pixels[start[19 * v + j] : start[19 * v + j + 1]]
            assert np.array_equal(mine, view.points[view.scores[:, j] > 0.1, j])
