"""Votes where things that are known stand between."""

from dataclasses import replace

import numpy as np
import pytest
from fed_stages import FedVoting

from panoptic_ros.association.known_occluders import MARGIN, limited, limits_of_rig
from panoptic_ros.domain import Occluders, VisibilityLimit
from panoptic_ros.params import load
from panoptic_ros.stage import StageContext
from panoptic_ros.voting.config import VotingConfig


def test_limits_of_depth_maps_and_of_occluders_both_count(scenes):
    rig = scenes.ring(3)
    wall = Occluders.box((0.1, 30.0, 30.0), np.eye(3), (0.6, 0.0, 0.0))  # between cameras 0 and 1, 2
    item = scenes.detect(rig, [scenes.person(-0.3, 0.0)])
    nearest = VisibilityLimit(np.full((2, 2), 100, np.uint16))
    item = replace(item, views=(item.views[0], replace(item.views[1], limit=nearest), item.views[2]))
    given = limited(item, limits_of_rig(replace(rig, occluders=wall)))
    assert given.views[0].limit is not None and given.views[0].limit.cells.shape == (120, 160)
    assert (given.views[1].limit.cells == 100).sum() > 0.9 * 120 * 160
    assert limits_of_rig(rig) == {}


@pytest.mark.parametrize("method", ["seeds", "exact"])
def test_a_joint_keeps_its_vote_though_a_wall_hides_it_from_half_of_the_views(scenes, method):
    rig = scenes.ring(4)
    person = scenes.person(-0.8, -0.8)
    turn = np.array([[1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 2.0**0.5]]) / 2.0**0.5
    wall = Occluders.box((0.1, 12.0, 6.0), turn, (0.0, 0.0, 1.0))
    item = scenes.detect(rig, [person])
    hidden = [v for v, eye in enumerate(rig.cameras) if eye.centre[:2].sum() > 0]
    nobody = {"points": np.zeros((0, 19, 2)), "scores": np.zeros((0, 19)), "person_scores": np.zeros(0)}
    views = tuple(replace(view, **nobody) if v in hidden else view for v, view in enumerate(item.views))
    item = replace(item, views=views)
    bounds = {"volume": [-1.3, -1.3, 0.0, -0.3, -0.3, 1.8], "without_maps": True}
    votes = {}
    for name, occluders in (("open", None), ("walled", wall)):
        context = StageContext(replace(rig, occluders=occluders), scenes.skeleton)
        stage = FedVoting(load(VotingConfig, {"method": method, **bounds}), context)
        found = stage.step(item).outputs[0]
        head = found.node_joints == 1
        near = np.linalg.norm(found.nodes[head] - person[1], axis=1) < 0.05
        votes[name] = found.node_scores[head][near].max()
        limited = [view.limit is not None for view in found.detections.views]
        assert all(limited) if occluders is not None else not any(limited)
    assert len(hidden) == 2
    assert votes["open"] == pytest.approx(0.45, abs=0.02 if method == "seeds" else 0.1)  # of a voxel's centre
    assert votes["walled"] == pytest.approx(2.0 * votes["open"], abs=0.03)
    assert MARGIN < 0.1
