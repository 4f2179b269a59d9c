"""The exact search against the dense one."""

from dataclasses import replace

import numpy as np
import pytest
from fed_stages import FedVoting
from hypothesis import given, settings
from hypothesis import strategies as st

from panoptic_ros.domain import Camera, Rig, ScoreMaps, ViewDetections, VisibilityLimit
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.stage import StageContext
from panoptic_ros.study.stage1.dense import dense_nodes, is_maximum
from panoptic_ros.voting.config import VotingConfig
from panoptic_ros.voting.exact import highest, maxima
from panoptic_ros.voting.proposals import NodeCriteria
from panoptic_ros.voting.scene import build_scene
from panoptic_ros.voting.stage import demands
from panoptic_ros.voting.volume import Volume

TWICE = (0.0, 0.0, 0.003, -0.002)  # shows places more than 88 degrees off its axis once more
LENSES = [
    (),
    (-0.25, 0.06, 0.001, -0.002, 0.01),
    (-0.6,),
    (0.3, 0.1),
    TWICE,
    Intrinsics(np.eye(3), (0.02, -0.01, 0.003, -0.001), "fisheye"),
    Intrinsics(np.eye(3), (-0.3,), "fisheye"),
]
NUMBERS = [  # threshold, view threshold, least
    (0.05, 0.1, 2),
    (0.2, 0.1, 3),
    (0.0, 0.0, 0),
    (0.3, 0.3, 4),
    (0.4, 0.1, 2),
    (0.5, 0.1, 1),
]


def searched(scene, volume, wanted):
    """Nodes of the dense search, and of the exact one."""
    return dense_nodes(scene, volume, wanted), maxima(scene, volume, wanted)


def compared(scene, volume, threshold, view_threshold, least):
    """The number of nodes; asserts that both searches find the same, bit for bit."""
    dense, exact = searched(scene, volume, NodeCriteria(threshold, least, view_threshold))
    assert all(map(np.array_equal, dense, exact))
    return len(dense.joints)


def lens_of(lens, matrix):
    """With another matrix, or of Brown's terms."""
    straight = lens if isinstance(lens, Intrinsics) else Intrinsics(np.eye(3), np.array(lens))
    return replace(straight, matrix=matrix)


def random_camera(rng, k, lens, inside):
    """Near the origin, perhaps within the volume, looking somewhere near its middle."""
    centre = rng.uniform(-0.8, 0.8, 3) if inside else rng.normal(size=3) * 1.5
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    rotation *= np.sign(np.linalg.det(rotation))
    if not inside and rotation[2] @ -centre < 0:
        rotation[1:] *= -1.0
    focal = rng.uniform(40.0, 160.0)
    matrix = np.array([[focal, rng.normal(), 80.0], [0.0, focal * 1.1, 60.0], [0.0, 0.0, 1.0]])
    pose = Rigid(rotation, -rotation @ centre)
    return Camera(f"cam{k}", (160, 120), lens_of(lens, matrix), pose)


def random_limit(rng):
    """Depths of 0.2 to 3 m in some cells, none in others."""
    cells = rng.integers(200, 3000, rng.integers(1, 25, 2)).astype(np.uint16)
    cells[rng.random(cells.shape) < rng.choice([0.0, 0.3, 0.9])] = 0
    return VisibilityLimit(cells)


def random_view(rng, camera, joints, people, maps, limits):
    """Keypoints of `people` anywhere in the image and beyond, and blocks of noise as maps of some joints."""
    points = rng.uniform(-30.0, 190.0, (people, joints, 2))
    scores = rng.uniform(0.05, 1.0, (people, joints)) * (rng.random((people, joints)) < 0.8)
    points[scores == 0.0] = np.nan
    drawn = None
    if maps:
        grid = (int(rng.integers(1, 40)), int(rng.integers(1, 30)))
        cells = np.array(grid) / (160.0, 120.0) * rng.uniform(0.7, 1.4)
        affine = np.array([[cells[0], rng.normal() * 0.02, -0.3], [rng.normal() * 0.02, cells[1], 0.4]])
        count = int(rng.integers(0, 3 * joints))
        corners = rng.integers(0, grid, (count, 2))
        sizes = np.minimum(rng.integers(1, 9, (count, 2)), np.array(grid) - corners)
        values = rng.integers(0, 256, int(sizes.prod(1).sum()))
        values[rng.random(len(values)) < 0.4] = 0
        drawn = ScoreMaps(
            grid,
            affine,
            rng.integers(0, joints, count),
            np.full(count, -1),
            corners,
            sizes,
            values.astype(np.uint8),
        )
    return ViewDetections(
        camera.name,
        0,
        0,
        camera.image_size,
        "x",
        points,
        scores,
        np.full(people, 0.5),
        drawn,
        random_limit(rng) if limits and rng.random() < 0.7 else None,
    )


@settings(max_examples=120, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    views=st.integers(0, 6),
    lens=st.sampled_from([lens for lens in LENSES if lens != TWICE]),
    joints=st.sampled_from([1, 3, 32, 35]),
    people=st.integers(0, 3),
    maps=st.sampled_from(["none", "all", "some"]),
    shape=st.tuples(*[st.integers(1, 21)] * 3),
    numbers=st.sampled_from(NUMBERS),
    inside=st.booleans(),
    limits=st.booleans(),
)
def test_finds_what_the_dense_search_finds(
    seed, views, lens, joints, people, maps, shape, numbers, inside, limits
):
    rng = np.random.default_rng(seed)
    cameras = [random_camera(rng, k, lens if k % 3 else (), inside and k % 2 == 0) for k in range(views)]
    seen = [
        random_view(rng, camera, joints, people, maps == "all" or (maps == "some" and k % 2), limits)
        for k, camera in enumerate(cameras)
    ]
    scene = build_scene(cameras, seen, joints)
    lower = -np.array(shape) // 2
    threshold, view_threshold, least = numbers
    volume = Volume(tuple(lower.tolist()), tuple((lower + shape).tolist()), 0.1)
    dense, exact = searched(scene, volume, NodeCriteria(threshold, least, view_threshold))
    for name, a, b in zip(dense._fields, dense, exact):
        assert np.array_equal(a, b), name


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("maps", ["none", "merged", "person", "mixed"])
def test_people_in_a_ring_of_cameras(scenes, maps, lens):
    rig = scenes.ring(5, lens)
    people = [scenes.person(0.3, 0.2), scenes.person(-0.2, -0.4, 2.0)]
    scene = build_scene(rig.cameras, scenes.detect(rig, people, maps).views, 19)
    volume = Volume.between((-0.8, -0.8, 0.0, 0.8, 0.8, 1.8), 0.05)
    assert compared(scene, volume, 0.1, 0.1, 3) > 10
    assert compared(scene, volume, 0.05, 0.1, 2) > 30


@pytest.mark.parametrize("lens", LENSES[:2])
def test_a_wall_before_some_cameras(scenes, lens):
    rig = scenes.ring(5, lens)
    views = scenes.detect(rig, [scenes.person(0.3, 0.2), scenes.person(-0.2, -0.4, 2.0)], "mixed").views
    wall = np.zeros((12, 16), np.uint16)
    wall[3:, 5:9] = 3950  # mm: between the people, seen from some of the cameras
    hidden = [replace(view, limit=VisibilityLimit(wall) if v % 2 else None) for v, view in enumerate(views)]
    volume = Volume.between((-0.8, -0.8, 0.0, 0.8, 0.8, 1.8), 0.05)
    free, walled = (build_scene(rig.cameras, seen, 19) for seen in (views, hidden))
    assert 10 < compared(walled, volume, 0.3, 0.1, 4) < compared(free, volume, 0.3, 0.1, 4)


@pytest.mark.parametrize("lens", [(-0.1, 0.02), LENSES[-2]])
@pytest.mark.parametrize("maps", ["none", "merged"])
def test_proposals_of_the_stage_are_those_of_dense(scenes, maps, lens):
    rig = scenes.ring(4, lens)
    item = scenes.detect(rig, [scenes.person(0.3, 0.2)], maps)
    bounds = (-1.0, -1.0, 0.0, 1.0, 1.0, 2.0)
    config = VotingConfig(method="exact", volume=bounds, without_maps=True)
    (found,) = FedVoting(config, StageContext(Rig(rig.cameras), scenes.skeleton)).step(item).outputs
    volume = Volume.between(bounds, config.voxel)
    expected = dense_nodes(build_scene(rig.cameras, item.views, 19), volume, demands(config, 4))
    assert np.array_equal(found.nodes, expected.points)
    assert np.array_equal(found.node_joints, expected.joints)
    assert np.array_equal(found.node_scores, expected.votes)
    assert np.array_equal(found.node_views, expected.support)
    assert len(found.nodes) >= 19


def test_a_camera_that_sees_nothing_changes_nothing(scenes):
    rig = scenes.ring(4)
    views = scenes.detect(rig, [scenes.person(0.0, 0.0)]).views
    away = rig.cameras[0]
    turned = np.diag([-1.0, 1.0, -1.0]) @ away.cam_from_world.rotation
    blind = Camera("blind", (640, 480), away.intrinsics, Rigid(turned, -turned @ away.centre))
    view = ViewDetections(
        "blind", 0, 0, (640, 480), views[0].skeleton_hash, np.zeros((0, 19, 2)), np.zeros((0, 19)), ()
    )
    volume = Volume.between((-0.6, -0.6, 0.0, 0.6, 0.6, 1.8), 0.05)
    one, two = (
        maxima(build_scene(cameras, seen, 19), volume, NodeCriteria(0.1, 3, 0.1))
        for cameras, seen in ((rig.cameras, views), ((blind, *rig.cameras), (view, *views)))
    )
    for a, b in zip(one, two):
        assert np.array_equal(a, b)


@given(seed=st.integers(0, 10**6), share=st.floats(0.0, 1.0), levels=st.integers(1, 20))
def test_the_highest_of_scattered_voxels(seed, share, levels):
    rng = np.random.default_rng(seed)
    rank = np.where(rng.random((2, 5, 4, 6)) < share, rng.integers(0, levels, (2, 5, 4, 6)) / 7.0, -1.0)
    at = np.argwhere(rank >= 0.0)
    expected = at[is_maximum(rank, at)]
    at = at[rng.permutation(len(at))]
    assert at[highest(at, rank[tuple(at.T)])].tolist() == expected.tolist()
