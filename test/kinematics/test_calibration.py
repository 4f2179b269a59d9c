"""The calibration's covariance in bodies, against rigs that are drawn from it."""

from dataclasses import replace

import captures
import numpy as np
import pytest
from drawn_rigs import drawn, triangulated
from stage_cases import SECOND, wearer

from panoptic_ros.domain import JointState, Rig, TrackedPoseSet
from panoptic_ros.graph.build import configure, make_stage
from panoptic_ros.refinement.stage import BodyFill
from panoptic_ros.solving.calibration_errors import CalibrationErrors

SD = np.array([*3 * (6e-4,), *3 * (2e-3,), *4 * (0.8,), *5 * (1e-3,)])  # rad, m, px, distortion
DOUBTFUL = Rig(tuple(replace(camera, covariance=np.diag(SD**2)) for camera in captures.RIG.cameras))
RIGS, BOUNDS = 25, (0.7, 1.3)
INSTANTS, RATE_HZ = 6, 30.0


def bodies(rig):
    """Return the last bodies of a person whose joints the rig triangulates from exact pixels."""
    config = configure({"kinematics": {"rate_hz": RATE_HZ, "lag": 0.0}})["kinematics"]
    stage, outputs = make_stage("kinematics", config, replace(wearer(), rig=rig)), []
    for k in range(INSTANTS):
        truth = captures.people(k / RATE_HZ)[0]
        pixels = np.stack([camera.project(truth)[0] for camera in captures.RIG.cameras])
        points, ones = triangulated(rig.cameras, pixels, truth)[None], np.ones((1, len(truth)))
        noise = np.tile(1e-6 * np.eye(3), (*ones.shape, 1, 1))
        poses = (points, noise, ones, 4 * ones, JointState.MEASURED * ones, np.ones(1))
        item = TrackedPoseSet(k, round(k * SECOND / RATE_HZ), captures.SKELETON.hash, *poses, ids=np.ones(1))
        outputs += stage.step(item).outputs
    assert outputs[-1].ids.tolist() == [1]
    return outputs[-1]


@pytest.fixture(scope="module")
def right():
    return bodies(DOUBTFUL), bodies(captures.RIG)


def test_drawn_rigs_have_the_predicted_errors(right):
    """Exact pixels, and a rig that is wrong by its covariance: NEES per degree of freedom is 1."""
    (own, plain), rng = right, np.random.default_rng(0)
    found = [bodies(Rig(tuple(drawn(camera, rng) for camera in DOUBTFUL.cameras))) for _ in range(RIGS)]
    known = np.isfinite(own.keypoints[0]).all(axis=1)
    for off, added in (
        (
            [(item.keypoints - own.keypoints)[0, known] for item in found],
            (own.keypoint_covariances - plain.keypoint_covariances)[0, known],
        ),
        (
            [(item.positions - own.positions)[0] for item in found],
            (own.covariances - plain.covariances)[0, :, :3, :3],
        ),
    ):
        squares = np.einsum("rni,nij,rnj->rn", off, np.linalg.inv(added), off) / 3.0
        assert BOUNDS[0] < squares.mean() < BOUNDS[1]
    assert known.sum() > 10


def test_the_calibration_changes_no_body_and_no_rotation(right):
    own, plain = right
    assert own.freedoms.tobytes() == plain.freedoms.tobytes()
    assert np.array_equal(own.covariances[..., 3:], plain.covariances[..., 3:])


def test_refinement_compares_bodies_without_the_errors_that_skeletons_share(right):
    kept = []
    biases = np.zeros((len(captures.SKELETON), 3, 3))
    for item, errors in zip(right, (CalibrationErrors.of(DOUBTFUL.cameras), None)):
        fill = BodyFill()
        fill.take(item, biases, errors)
        kept.append(fill._kept[0].covariances)
    np.testing.assert_allclose(*kept, atol=1e-15)
