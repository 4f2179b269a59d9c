"""Velocities of new joints: motion where views show it, rest where they only disagree."""

import numpy as np
import pytest
from gaussians import conditioned, positive

from panoptic_ros.domain import SkeletonModel, TimeShift, TrackedPoseSet
from panoptic_ros.refinement.config import RefinementConfig
from panoptic_ros.refinement.stage import RefinementStage
from panoptic_ros.refinement.start_motion import likely_velocities, started
from panoptic_ros.stage import StageContext

JOINTS, LARGEST, CAUCHY = 19, 1.5, 3.0


def seen(rng, speed, errors=1.0, deviations=(0.2, 0.8, 20.0)):
    """True velocities, what views say of them with errors larger than stated, and the information."""
    truth = speed * rng.standard_normal((JOINTS, 3))
    axes = np.linalg.qr(rng.standard_normal((JOINTS, 3, 3)))[0]
    noise = errors * (axes @ (np.array(deviations) * rng.standard_normal((JOINTS, 3)))[..., None])[..., 0]
    information = axes @ np.diag(np.array(deviations) ** -2.0) @ np.swapaxes(axes, 1, 2)
    return truth, truth + noise, information


def of_many(speed, errors=1.0):
    """Root mean squares over many people: errors of the found velocities, and of those of rest; NEES."""
    rng = np.random.default_rng(0)
    found, rest, normalised = [], [], []
    for _ in range(40):
        truth, velocities, information = seen(rng, speed, errors)
        mean, spread = likely_velocities(velocities, information, LARGEST, CAUCHY)
        away = mean - truth
        found.append((away**2).mean())
        rest.append((truth**2).mean())
        normalised.append(np.einsum("ji,jik,jk->j", away, np.linalg.inv(spread), away).mean() / 3.0)
    return np.sqrt(np.mean(found)), np.sqrt(np.mean(rest)), np.mean(normalised)


@pytest.mark.parametrize("speed", [0.1, 0.3, 1.0, 1.5])
def test_slow_and_fast_people_are_known_for_what_they_are(speed):
    found, rest, normalised = of_many(speed)
    assert found < max(0.9 * rest, 0.12)
    assert 0.3 < normalised < 2.0


@pytest.mark.parametrize("errors", [4.0, 16.0])
def test_errors_far_beyond_the_stated_ones_are_no_motion(errors):
    found, rest, _ = of_many(0.2, errors)
    assert found < 1.3 * rest


def test_one_joint_that_is_far_off_does_not_make_a_person_fast():
    _, velocities, information = seen(np.random.default_rng(1), 0.1)
    before, _ = likely_velocities(velocities, information, LARGEST, CAUCHY)
    velocities[4] += 30.0
    after, _ = likely_velocities(velocities, information, LARGEST, CAUCHY)
    others = np.arange(JOINTS) != 4
    assert np.abs(after - before)[others].max() < 0.1
    assert np.linalg.norm(after[4]) < 10.0


def test_views_that_say_nothing_leave_rest_and_doubt():
    zero = np.zeros((JOINTS, 3))
    mean, spread = likely_velocities(zero, np.zeros((JOINTS, 3, 3)), LARGEST, CAUCHY)
    assert np.array_equal(mean, zero)
    deviations = np.sqrt(spread[:, range(3), range(3)])
    assert (deviations > 0.3).all() and (deviations < LARGEST).all()


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
            _, velocities, information = seen(rng, 0.0, errors, (0.7, 1.5, 30.0))
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
        stage = RefinementStage(RefinementConfig(), StageContext(None, self.model))
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
    velocity, spread = rng.standard_normal(3), positive(rng, 3, 1.5)
    motion = started(point[None], noise[None], delays[None], velocity[None], spread[None])
    prior = np.zeros((6, 6))
    prior[:3, :3], prior[3:, 3:] = 1e8 * np.eye(3), spread
    start = np.concatenate([np.zeros(3), velocity])
    expected = conditioned(start, prior, np.hstack([np.eye(3), delays]), point, noise)
    assert np.allclose(motion.states[0], expected[0], atol=1e-5)
    assert np.allclose(motion.covariances[0], expected[1], atol=1e-5)
