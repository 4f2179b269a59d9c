"""Initial states of new joints: at rest, and as uncertain as motion makes them."""

import numpy as np
import pytest
from gaussians import conditioned, positive

from panoptic_ros.domain import Rig, SkeletonModel, TimeShift, TrackedPoseSet
from panoptic_ros.refinement.config import RefinementConfig
from panoptic_ros.refinement.records import started
from panoptic_ros.refinement.stage import RefinementStage
from panoptic_ros.stage import StageContext

JOINTS = 19


class TestSlowCameras:
    """Two sets a second of somebody who stands, in views that lie together, 0.4 s after the set's instant.

    The views are 10 ms apart and disagree by some centimetres: as motion that would be metres a second.
    """

    model = SkeletonModel(
        "chain", tuple(f"joint{j}" for j in range(JOINTS)), 0, tuple((j, j + 1) for j in range(JOINTS - 1)), 0
    )

    def sets(self, errors):
        rng = np.random.default_rng(2)
        self.person = rng.uniform(0.0, 1.7, (JOINTS, 3))
        ones = np.ones((1, JOINTS))
        for index in range(8):
            axes, deviations = (
                np.linalg.qr(rng.standard_normal((JOINTS, 3, 3)))[0],
                np.array((0.7, 1.5, 30.0)),
            )
            velocities = errors * (axes @ (deviations * rng.standard_normal((JOINTS, 3)))[..., None])[..., 0]
            information = axes @ np.diag(deviations**-2.0) @ np.swapaxes(axes, 1, 2)
            shift = TimeShift(
                np.tile(0.4 * np.eye(3), (1, JOINTS, 1, 1)),
                np.zeros((1, JOINTS, 3)),
                velocities[None],
                information[None],
            )
            yield TrackedPoseSet(
                index,
                10**9 + index * 500_000_000,
                self.model.hash,
                self.person + rng.normal(0.0, 0.01, (1, JOINTS, 3)),
                np.tile(1e-4 * np.eye(3), (1, JOINTS, 1, 1)),
                ones,
                3 * ones,
                ones,
                np.ones(1),
                time_shift=shift,
                ids=[0],
            )

    @pytest.mark.parametrize("errors", [1.0, 4.0])
    def test_who_stands_is_not_moved_by_what_views_disagree_about(self, errors):
        stage = RefinementStage(RefinementConfig(), StageContext(Rig(()), self.model))
        results = [stage.step(item) for item in self.sets(errors)] + [stage.flush()]
        outputs = [output for result in results for output in result.outputs]
        assert len(outputs) == 8
        gaps = [np.linalg.norm(o.positions[0] - self.person, axis=1).mean() for o in outputs]
        assert max(gaps) < 0.1
        for output in outputs:  # it is not known either: people may move within 0.4 s
            assert np.sqrt(output.covariances[0, :, 0, 0]).min() > 0.02


def test_a_new_point_starts_as_if_its_position_had_been_unknown():
    rng = np.random.default_rng(2)
    point, noise, delays = rng.standard_normal(3), positive(rng, 3, 0.1), 0.02 * rng.standard_normal((3, 3))
    motion = started(point[None], noise[None], delays[None], 1.5)
    prior = np.zeros((6, 6))
    prior[:3, :3], prior[3:, 3:] = 1e8 * np.eye(3), 1.5**2 * np.eye(3)
    expected = conditioned(np.zeros(6), prior, np.hstack([np.eye(3), delays]), point, noise)
    assert np.allclose(motion.states[0], expected[0], atol=1e-5)
    assert np.allclose(motion.covariances[0], expected[1], atol=1e-5)
