"""The paper's averaging over a whole recording, against exact motion."""

from dataclasses import replace

import captures
import numpy as np
import patch_scene
import pytest

from panoptic_ros.domain import JointState, PatchTracks
from panoptic_ros.errors import UsageError
from panoptic_ros.graph.build import configure, make_stage
from panoptic_ros.graph.offline_refinement import refinement_of

WRIST = list(captures.SKELETON.joint_names).index("lWrist")
COUNT, GAP = 9, (4, 5)
AVERAGING = {"refinement": {"method": "averaging"}, "patches": {"active": True}}


def averaged(items, **more):
    averaging = refinement_of(configure({**AVERAGING, **more}), captures.CONTEXT)
    for item in items:
        assert list(averaging.take(item)) == []
    return list(averaging.flush()), averaging.rounds


@pytest.fixture(scope="module")
def scene():
    """Somebody who turns and goes, whose wrist is missing for two instants; and his true joints."""
    return patch_scene.recording_with_gap(COUNT, GAP, WRIST)


def test_a_gap_is_filled_and_says_so(scene):
    found, rounds = averaged(scene[0])
    assert [output.index for output in found] == list(range(COUNT)) and rounds >= 2
    for output in found:
        filled = output.index in GAP
        assert output.states[0][WRIST] == (JointState.FILLED if filled else JointState.MEASURED)
        assert output.positions[0] == pytest.approx(scene[1][output.index], abs=0.02)
        assert (output.covariances[0][WRIST, 0, 0] == pytest.approx(0.01)) == filled


def test_sets_from_the_past_are_left_out(scene):
    last = next(item for item in reversed(scene[0]) if not isinstance(item, PatchTracks))
    found, _ = averaged([*scene[0], replace(last, index=99)])
    assert [output.index for output in found] == list(range(COUNT))


def test_without_the_motion_of_the_surface_it_is_refused():
    with pytest.raises(UsageError, match=r"averaging needs .* patches\.active"):
        averaged([], patches={"active": False})


def test_online_skeletons_pass_through(scene):
    stage = make_stage("refinement", configure(AVERAGING)["refinement"], captures.CONTEXT)
    for item in scene[0]:
        if not isinstance(item, PatchTracks):
            (output,) = stage.step(item).outputs
            assert np.array_equal(output.positions, item.positions, equal_nan=True)
