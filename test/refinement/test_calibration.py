"""The calibration's covariance in refined skeletons: added once, whatever the smoothing."""

from dataclasses import replace

import captures
import numpy as np
import pytest
from blobs import SKELETON

from panoptic_ros.domain import Rig, TrackedPoseSet, ViewSources
from panoptic_ros.refinement.config import RefinementConfig
from panoptic_ros.refinement.stage import RefinementStage
from panoptic_ros.solving.calibration_errors import CalibrationErrors
from panoptic_ros.stage import StageContext


def refined(cameras, enabled):
    """Return the output of the last of ten sets of one person who stands still."""
    rig = Rig(cameras)
    stage = RefinementStage(RefinementConfig(enabled=enabled), StageContext(rig, SKELETON))
    count = len(SKELETON)
    ones, eyes = np.ones((1, count)), np.tile(1e-4 * np.eye(3), (1, count, 1, 1))
    points = np.random.default_rng(0).uniform([-0.3, -0.3, 0.5], [0.3, 0.3, 1.5], (1, count, 3))
    numbers = np.zeros(len(cameras), np.int64)
    sources = ViewSources(rig.names, numbers, numbers[None])
    outputs = []
    for k in range(10):
        poses = (points, eyes, ones, 2 * ones, ones, np.ones(1))
        item = TrackedPoseSet(k, k * 33_000_000, SKELETON.hash, *poses, sources=sources, ids=np.zeros(1))
        outputs += stage.step(item).outputs
    return [*outputs, *stage.flush().outputs][-1]


@pytest.mark.parametrize("enabled", [False, True])
def test_the_calibration_is_added_to_the_result_alone(enabled: bool) -> None:
    """Positions keep their bytes; covariances grow by the calibration's, also after smoothing."""
    plain = tuple(replace(camera, covariance=None) for camera in captures.RIG.cameras)
    doubtful = tuple(
        replace(one, covariance=1e-6 * np.eye(10 + len(one.intrinsics.distortion))) for one in plain
    )
    without, own = refined(plain, enabled), refined(doubtful, enabled)
    errors = CalibrationErrors.of(doubtful)
    assert errors is not None and own.sources is not None
    added = errors.of_people(own.positions, own.sources.cameras, own.sources.persons)
    assert (np.trace(added, axis1=-2, axis2=-1) > 0.0).all()
    assert own.positions.tobytes() == without.positions.tobytes()
    np.testing.assert_allclose(own.covariances - without.covariances, added, atol=1e-15)
