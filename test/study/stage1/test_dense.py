"""Votes of all voxels, and which of these are local maxima."""

import numpy as np
import pytest

from panoptic_ros.study.stage1 import dense
from panoptic_ros.study.stage1.layouts import make_world
from panoptic_ros.voting.proposals import NodeCriteria
from panoptic_ros.voting.scene import build_scene
from panoptic_ros.voting.volume import Volume
from panoptic_ros.voting.votes import at_rest, vote_points

WANTED = NodeCriteria(0.1, 2, 0.1)


@pytest.fixture(scope="module")
def scene():
    world = make_world(people=2, views=4, frames=1, seed=1, maps=True)
    item = world.sets[0]
    return build_scene([world.rig.camera(view.camera) for view in item.views], item.views, 19)


@pytest.fixture(scope="module")
def box(scene):
    """Half a metre about some joint."""
    joint, _ = seeds(scene)
    return Volume.between((*(joint - 0.25), *(joint + 0.25)), 0.05)


def seeds(scene):
    """Where the vote of a joint is high, and which joint."""
    rng = np.random.default_rng(0)
    points, joints = rng.uniform((-2, -2, 0), (2, 2, 2), (20000, 3)), rng.integers(0, 19, 20000)
    best = int(np.argmax(vote_points(scene, joints, points, at_rest(points, scene), 0.1)[0]))
    return points[best], joints[best]


def test_a_block_of_voxels_holds_the_votes_of_its_centres(scene, box):
    votes, support = dense.vote_block(scene, box, 0.1)
    grid = np.stack(np.meshgrid(*(np.arange(n) for n in box.shape), indexing="ij"), -1).reshape(-1, 3)
    for joint in (seeds(scene)[1], 2):
        points = box.centres(grid + box.lower)
        one, views = vote_points(scene, np.full(len(grid), joint), points, at_rest(points, scene), 0.1)
        assert (votes[joint].ravel() == one).all()
        assert (support[joint].ravel() == views).all()
    assert votes.max() > 0.3


def test_nodes_are_the_voxels_that_beat_their_neighbours(scene, box):
    nodes = dense.dense_nodes(scene, box, WANTED)
    votes, support = dense.vote_block(scene, box, 0.1)
    expected = set()
    eligible = np.where(support >= 2, votes, -1.0)
    for j, x, y, z in np.argwhere(eligible > 0.1):
        window = eligible[j, max(x - 1, 0) : x + 2, max(y - 1, 0) : y + 2, max(z - 1, 0) : z + 2]
        if eligible[j, x, y, z] >= window.max():
            expected.add((j, *(np.array([x, y, z]) + box.lower).tolist()))
    voxels = np.floor(nodes.points / box.side).astype(int)
    found = {(j, *voxel) for j, voxel in zip(nodes.joints.tolist(), voxels.tolist())}
    assert found == expected
    assert len(found) > 3


def test_slabs_make_no_difference(scene, box, monkeypatch):
    whole = dense.dense_nodes(scene, box, WANTED)
    monkeypatch.setattr(dense, "BLOCK_VALUES", 19 * box.shape[1] * box.shape[2] * 3)
    for a, b in zip(whole, dense.dense_nodes(scene, box, WANTED)):
        assert np.array_equal(a, b)


def test_of_a_plateau_one_voxel_is_the_peak():
    rank = np.zeros((1, 4, 3, 3))
    rank[0, 1:3, 1, 1] = 0.5
    at = np.argwhere(rank > 0.0)
    assert dense.is_maximum(rank, at).tolist() == [True, False]
