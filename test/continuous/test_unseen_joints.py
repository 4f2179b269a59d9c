"""Joints that the detector does not see are derived from others or missing, and harm no other joint."""

from dataclasses import replace

import captures
import numpy as np
import pytest
from free_cameras import FreeCapture

from panoptic_ros.continuous.config import ContinuousConfig
from panoptic_ros.continuous.passes import ContinuousPass
from panoptic_ros.domain import JointState
from panoptic_ros.graph.recording import InMemoryRecording
from panoptic_ros.stage import StageContext, untold

NECK, NOSE, LEFT, RIGHT = (
    captures.SKELETON.joint_names.index(n) for n in ("Neck", "Nose", "lShoulder", "rShoulder")
)


@pytest.fixture(scope="module")
def motion():
    """Motion from 2D people without neck and nose; the neck is the mean of the shoulders."""
    skeleton = replace(captures.SKELETON, derived=((NECK, (LEFT, RIGHT)),))
    capture = FreeCapture(seconds=3.0)
    sets = []
    for item in capture.sets:
        (view,) = item.views
        points, scores = view.points.copy(), view.scores.copy()
        points[:, [NECK, NOSE]], scores[:, [NECK, NOSE]] = np.nan, 0.0
        seen = replace(view, points=points, scores=scores, skeleton_hash=skeleton.hash)
        sets.append(replace(item, skeleton_hash=skeleton.hash, views=(seen,)))
    context = StageContext(capture.rig, skeleton)
    recording = InMemoryRecording({"detection_sets": sets})
    return capture, ContinuousPass(ContinuousConfig(), context).run(recording, untold)


TIMES = np.arange(0.3, 2.7, 0.05)


def test_the_other_joints_are_right(motion):
    capture, found = motion
    errors = capture.errors(found, TIMES)
    others = [j for j in range(19) if j not in (NECK, NOSE)]
    assert np.isfinite(errors[:, :, others]).all() and errors[:, :, others].mean() < 0.006
    assert np.isnan(errors[:, :, NOSE]).all()


def test_a_derived_joint_is_the_mean_with_its_covariance(motion):
    _, found = motion
    for item in found.sets(found.at_rate(20.0)[6:-6]):
        means = item.positions[:, [LEFT, RIGHT]].mean(axis=1)
        np.testing.assert_allclose(item.positions[:, NECK], means, atol=1e-12)
        np.testing.assert_allclose(
            item.covariances[:, NECK], item.covariances[:, [LEFT, RIGHT]].sum(axis=1) / 4.0, rtol=1e-9
        )
        assert (item.states[:, NECK] == JointState.MEASURED).all() and (item.views[:, NECK] > 1).all()
        assert (item.states[:, NOSE] == JointState.MISSING).all()
