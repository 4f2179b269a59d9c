"""Joints that the detector does not see are derived from others or missing, and harm no other joint."""

from dataclasses import replace

import captures
import cv2
import numpy as np
import pytest
from free_cameras import START_NS, FreeCapture

from panoptic_ros.continuous.config import ContinuousConfig
from panoptic_ros.continuous.passes import ContinuousPass
from panoptic_ros.domain import JointState
from panoptic_ros.graph.recording import InMemoryRecording
from panoptic_ros.stage import StageContext, untold

NECK, NOSE, LEFT, RIGHT = (
    captures.SKELETON.joint_names.index(n) for n in ("Neck", "Nose", "lShoulder", "rShoulder")
)
LOWER, SECOND = ("Hip", "Knee", "Ankle"), 1_000_000_000


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


class Walkers(FreeCapture):
    """The legs swing about the hips, left and right in turn."""

    def joints(self, time_s):
        bodies = super().joints(time_s)
        for side, sign in (("l", 1.0), ("r", -1.0)):
            hip, *leg = (captures.SKELETON.joint_names.index(side + name) for name in LOWER)
            for body in bodies:
                across = body[LEFT] - body[RIGHT]
                turn = cv2.Rodrigues(sign * 0.5 * np.sin(6.0 * time_s) * across / np.linalg.norm(across))[0]
                body[leg] = body[hip] + (body[leg] - body[hip]) @ turn.T
        return bodies


def test_joints_that_leave_the_images_stay_honest_and_do_not_pull_the_others():
    """Hide the lower body of walkers from 1.2 s to 2.6 s."""
    capture = Walkers(seconds=4.0, speed=1.0)
    low = [captures.SKELETON.joint_names.index(side + name) for side in "lr" for name in LOWER]
    low += [captures.SKELETON.joint_names.index("BodyCenter")]
    for k, item in enumerate(capture.sets):
        (view,) = item.views
        if 1.2 < 1e-9 * (view.stamp_ns - START_NS) < 2.6:
            points, scores = view.points.copy(), view.scores.copy()
            points[:, low], scores[:, low] = np.nan, 0.0
            capture.sets[k] = replace(item, views=(replace(view, points=points, scores=scores),))
    recording = InMemoryRecording({"detection_sets": capture.sets})
    found = ContinuousPass(ContinuousConfig(), capture.context).run(recording, untold)
    high = [j for j in range(19) if j not in low]
    assert np.nanmean(capture.errors(found, np.arange(1.3, 2.5, 0.05))[:, :, high]) < 0.004
    squares = []
    for item in found.sets(START_NS + np.arange(1.25, 2.55, 0.05) * SECOND):
        truth = capture.joints(1e-9 * (item.stamp_ns - START_NS))
        for k, body in enumerate(item.positions):
            gaps = body - truth[np.nanmean(np.linalg.norm(truth - body, axis=-1), axis=1).argmin()]
            for j in (j for j in low if item.states[k, j] != JointState.MISSING):
                squares.append(gaps[j] @ np.linalg.solve(item.covariances[k, j], gaps[j]) / 3.0)
    assert len(squares) > 100 and np.mean(squares) < 6.0
