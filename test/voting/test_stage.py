from dataclasses import replace

import numpy as np
import pytest
from fed_stages import FedVoting, associated
from rolling import with_line_delays

from panoptic_ros.domain import DetectionSet, Prediction, Rig, ViewDetections
from panoptic_ros.errors import ConfigError, DataError
from panoptic_ros.stage import Stage, StageContext
from panoptic_ros.voting.config import VotingConfig
from panoptic_ros.voting.proposals import distinct
from panoptic_ros.voting.stage import VotingStage

BOX = (-1.0, -1.0, 0.0, 1.0, 1.0, 2.0)


def propose(scenes, rig, item, **config):
    """All that the stage can give: also without maps, and parts."""
    config = VotingConfig(**{"without_maps": True, "parts": True} | config)
    stage = FedVoting(config, StageContext(rig, scenes.skeleton))
    assert isinstance(stage.stage, Stage)
    result = stage.step(item)
    assert stage.stage.flush().outputs == ()
    return result.outputs[0]


def missed(proposals, people, distance):
    """Joints of people without a node of their kind within a distance."""
    found = []
    for i, joints in enumerate(people):
        for j, place in enumerate(joints):
            nodes = proposals.nodes[proposals.node_joints == j]
            if not (np.linalg.norm(nodes - place, axis=1) < distance).any():
                found.append((i, j))
    return found


@pytest.mark.parametrize("distortion", [(), (-0.15, 0.03, 0.001, -0.001)])
@pytest.mark.parametrize("maps", ["none", "merged", "person", "mixed"])
def test_seeds_find_what_exact_finds_at_the_true_joints(scenes, maps, distortion):
    rig = scenes.ring(4, distortion)
    people = [scenes.person(0.4, 0.3), scenes.person(-0.3, -0.4, 2.0)]
    item = scenes.detect(rig, people, maps)
    seeds = propose(scenes, rig, item, method="seeds", explain_away=False, volume=BOX)
    exact = propose(scenes, rig, item, method="exact", volume=BOX)
    assert not missed(seeds, people, 0.015) and not missed(exact, people, 0.04)  # voxels are 4 cm wide
    true = np.stack(people)[:, exact.node_joints].swapaxes(0, 1)
    for k in np.flatnonzero((np.linalg.norm(exact.nodes[:, None] - true, axis=-1) < 0.04).any(1)):
        same = np.flatnonzero(seeds.node_joints == exact.node_joints[k])
        nearest = same[np.argmin(np.linalg.norm(seeds.nodes[same] - exact.nodes[k], axis=1))]
        assert seeds.nodes[nearest] == pytest.approx(exact.nodes[k], abs=0.04)
        assert seeds.node_scores[nearest] > exact.node_scores[k] - 0.02


@pytest.mark.parametrize("maps", ["none", "merged"])
def test_refined_nodes_are_where_the_joints_are(scenes, maps):
    rig = scenes.ring(6)
    people = [scenes.person(0.5, 0.3), scenes.person(-0.6, -0.5, 2.0)]
    assert not missed(propose(scenes, rig, scenes.detect(rig, people, maps)), people, 0.012)


def test_parts_connect_the_joints_of_one_person(scenes):
    rig = scenes.ring(6)
    people = [scenes.person(0.35, 0.0), scenes.person(-0.35, 0.0, np.pi)]
    proposals = propose(scenes, rig, scenes.detect(rig, people, score=0.8))
    away = np.linalg.norm(np.stack(people)[:, proposals.node_joints] - proposals.nodes, axis=-1)
    owner = np.where(away.min(0) < 0.02, away.argmin(0), -1)  # -1: where rays of different people cross
    a, b = proposals.parts.T
    same = (owner[a] == owner[b]) & (owner[a] >= 0)
    bones = scenes.skeleton.bones
    assert [bones[k] for k in proposals.part_bones] == list(
        zip(proposals.node_joints[a], proposals.node_joints[b])
    )
    assert proposals.part_scores[same] == pytest.approx(0.8, abs=0.05)
    assert {(owner[u], k) for u, k in zip(a[same], proposals.part_bones[same])} == {
        (i, k) for i in range(2) for k in range(18)
    }
    assert proposals.part_scores[~same].max(initial=0.0) < 0.4


def test_off_carries_the_detections_along(scenes):
    rig = scenes.ring(3)
    item = scenes.detect(rig, [scenes.person(0.0, 0.0)])
    proposals = propose(scenes, rig, item, method="off")
    assert proposals.detections is item
    assert len(proposals.nodes) == len(proposals.parts) == 0


@pytest.mark.parametrize("method", ["seeds", "exact"])
def test_votes_only_where_a_view_has_maps_and_parts_only_where_they_are_read(scenes, method):
    rig = scenes.ring(4)
    people = [scenes.person(0.0, 0.0)]
    options = {"method": method, "volume": (-0.6, -0.6, 0.0, 0.6, 0.6, 1.8), "voxel": 0.1}
    stage = FedVoting(VotingConfig(**options), StageContext(rig, scenes.skeleton))
    for maps in ("none", "mixed", "merged", "none"):
        item = scenes.detect(rig, people, maps)
        (found,) = stage.step(item).outputs
        assert found.detections is item and len(found.parts) == 0
        assert (len(found.nodes) > 0) == (maps != "none")
        asked = propose(scenes, rig, item, **options)
        assert len(asked.nodes) > 0 and len(asked.parts) > 0
        if maps != "none":
            assert np.array_equal(asked.nodes, found.nodes)


@pytest.mark.parametrize("method", ["seeds", "exact"])
@pytest.mark.parametrize("maps", ["none", "merged"])
def test_nothing_to_vote_on(scenes, maps, method):
    rig = scenes.ring(3)
    item = scenes.detect(rig, [], maps)
    seen = scenes.detect(rig, [scenes.person(0.0, 0.0)], maps)
    one = DetectionSet(0, 0, item.skeleton_hash, seen.views[:1])
    for each in (item, DetectionSet(0, 0, item.skeleton_hash, ()), one):
        assert len(propose(scenes, rig, each, method=method, volume=BOX, voxel=0.1).nodes) == 0


@pytest.mark.parametrize("maps", ["none", "merged", "person"])
def test_order_of_people_and_cameras_does_not_matter(scenes, maps):
    rig = scenes.ring(5)
    people = [scenes.person(0.4, 0.3), scenes.person(-0.3, -0.4, 2.0), scenes.person(0.0, 0.9, 4.0)]
    one = propose(scenes, rig, scenes.detect(rig, people, maps))
    again = propose(scenes, rig, scenes.detect(rig, people, maps))
    other = propose(scenes, rig, scenes.detect(rig, people[::-1], maps))
    turned = Rig(rig.cameras[::-1])
    mirrored = scenes.detect(rig, people, maps)
    mirrored = DetectionSet(0, 1000, mirrored.skeleton_hash, mirrored.views[::-1])
    third = propose(scenes, turned, mirrored)
    for name in ("nodes", "node_joints", "node_scores", "node_views", "parts", "part_bones", "part_scores"):
        assert np.array_equal(getattr(one, name), getattr(again, name))
        assert np.allclose(getattr(one, name), getattr(other, name), atol=1e-9), name
        assert np.allclose(getattr(one, name), getattr(third, name), atol=1e-9), name


def test_detectors_that_see_half_of_the_body_twice(scenes):
    rig = scenes.ring(4)
    item = scenes.detect(rig, [scenes.person(0.0, 0.0)])
    views = [
        ViewDetections(
            v.camera,
            0,
            0,
            v.image_size,
            v.skeleton_hash,
            np.repeat(v.points, 2, 0),
            np.repeat(v.scores, 2, 0),
            np.repeat(v.person_scores, 2),
        )
        for v in item.views
    ]
    twice = propose(scenes, rig, DetectionSet(0, 0, item.skeleton_hash, tuple(views)))
    once = propose(scenes, rig, item)
    assert np.array_equal(once.nodes, twice.nodes)
    assert np.array_equal(once.part_scores, twice.part_scores)


def test_bad_sets_name_what_is_wrong(scenes):
    rig = scenes.ring(3)
    stage = FedVoting(VotingConfig(), StageContext(rig, scenes.skeleton))
    item = scenes.detect(rig, [scenes.person(0.0, 0.0)])
    view = item.views[0]
    with pytest.raises(DataError, match="rig lacks"):
        stage.step(scenes.detect(scenes.ring(4), []))
    with pytest.raises(DataError, match="skeleton"):
        stage.step(DetectionSet(0, 0, "other", ()))
    bad = ViewDetections("cam0", 0, 0, (320, 240), view.skeleton_hash, view.points, view.scores, [0.9])
    with pytest.raises(DataError, match="320, 240"):
        stage.step(DetectionSet(0, 0, view.skeleton_hash, (bad,)))
    short = ViewDetections(
        "cam0", 0, 0, (640, 480), view.skeleton_hash, view.points[:, :7], view.scores[:, :7], [0.9]
    )
    with pytest.raises(DataError, match="7 joints"):
        stage.step(DetectionSet(0, 0, view.skeleton_hash, (short,)))
    with pytest.raises(ConfigError, match="not a box"):
        FedVoting(VotingConfig(volume=(0.0, 1.0)), StageContext(rig, scenes.skeleton))


def test_of_nodes_that_are_close_the_best_stays():
    nodes = np.array([[0.0, 0, 0], [0.01, 0, 0], [0.02, 0, 0], [0.5, 0, 0], [0.0, 0, 0]])
    kept = distinct(nodes, np.array([1, 1, 1, 1, 2]), np.array([0.2, 0.3, 0.1, 0.2, 0.1]), 0.015)
    assert kept.tolist() == [1, 3, 4]


def test_views_of_rolling_shutters_vote_at_their_middle_rows(scenes):
    """A person in motion, whom the views show 10 ms after the instant of the set."""
    rig, late, velocity = scenes.ring(6), 0.01, np.array([4.0, -3.0, 1.0])
    item = scenes.detect(rig, [scenes.person(0.3, 0.2) + late * velocity], "merged")
    found = associated(item, StageContext(rig, scenes.skeleton))
    place, ones = found.places - late * velocity, np.ones((1, 19))
    motion = Prediction(place, np.tile(velocity, (1, 19, 1)), 0.03 * ones, np.ones((1, 19, 3)), ones > 0)
    found = replace(found, places=place, who=np.zeros(1, np.int64), prediction=motion)
    line = 1e6 * late / (0.5 * (rig.cameras[0].image_size[1] - 1))
    nodes = []
    for rolls in (True, False):
        own = with_line_delays(rig, (line,)) if rolls else rig
        stamp = item.stamp_ns + (0 if rolls else round(1e9 * late))
        views = tuple(replace(view, stamp_ns=stamp) for view in item.views)
        given = replace(found, detections=replace(item, views=views))
        stage = VotingStage(VotingConfig(), StageContext(own, scenes.skeleton))
        nodes.append(stage.step(given).outputs[0])
    assert len(nodes[0].nodes) and not missed(nodes[0], [scenes.person(0.3, 0.2)], 0.015)
    assert np.allclose(nodes[0].nodes, nodes[1].nodes, atol=1e-9)
