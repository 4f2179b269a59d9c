"""BVH: another reader finds the joints where the bodies have them."""

import numpy as np
import pytest
from bodies import BODY, MODEL, placed, some_pose

from panoptic_ros.domain.subjects import BodyState
from panoptic_ros.errors import DataError
from panoptic_ros.export.bvh import bvh_text
from panoptic_ros.io.motion_files import read_bvh


def states(stamps):
    found = []
    for k, stamp in enumerate(stamps):
        frames, places = placed(some_pose(k))
        found.append(BodyState(stamp, 3, places, frames))
    return found


def test_joints_read_back_are_those_of_the_bodies(tmp_path):
    own = states([20_000_000 * k for k in range(5)])
    (tmp_path / "a.bvh").write_text(bvh_text(MODEL, own))
    back = read_bvh(tmp_path / "a.bvh", 0.01)
    assert back.rate == pytest.approx(50.0) and len(back.joints) == 5
    columns = [back.joint_names.index(name) for name in MODEL.names]
    assert back.joints[:, columns] == pytest.approx(np.array([s.places for s in own]), abs=1e-4)


def test_the_turn_of_a_bone_about_itself_is_kept(tmp_path):
    plain, twisted = states([0, 20_000_000])
    forearm, hand = MODEL.index("lForearm"), MODEL.index("lHand")
    turn = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # about y, which the bone is along
    twisted.frames[:], twisted.places[:] = plain.frames, plain.places
    twisted.frames[forearm] = twisted.frames[forearm] @ turn
    text = bvh_text(MODEL, [plain, twisted])
    first, second = (np.array(line.split(), float) for line in text.splitlines()[-2:])
    changed = np.flatnonzero(np.abs(first - second) > 1e-3)
    named = [line.split()[1] for line in text.splitlines() if line.strip().startswith(("ROOT", "JOINT"))]
    assert {named[(c - 3) // 3] for c in changed} == {"lForearm", "lHand"}
    assert BODY.model.parents[hand] == forearm


def test_an_instant_that_lacks_is_the_one_before(tmp_path):
    own = states([0, 20_000_000, 40_000_000, 80_000_000])
    rows = bvh_text(MODEL, own).splitlines()[-5:]
    assert rows[3] == rows[2] != rows[4]
    with pytest.raises(DataError, match="two instants of a body at least; there are 1"):
        bvh_text(MODEL, own[:1])
