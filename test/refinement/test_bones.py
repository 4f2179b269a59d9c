"""The compiled loops over bones against numpy."""

import numpy as np

from panoptic_ros.domain import JointState, Rig, SkeletonModel, TrackedPoseSet
from panoptic_ros.refinement.bones import on_bones, pull_bones
from panoptic_ros.refinement.config import RefinementConfig
from panoptic_ros.refinement.joint_states import SmoothedJoints
from panoptic_ros.refinement.records import new_people, unknown
from panoptic_ros.refinement.stage import RefinementStage
from panoptic_ros.stage import StageContext

SECOND = 10**9
BONES = np.array([[0, 1], [1, 2], [1, 3]])
MISSING, MEASURED, FILLED = int(JointState.MISSING), int(JointState.MEASURED), int(JointState.FILLED)


def joints(seed, people=1):
    """Positions (P, 4, 3), covariances (P, 4, 3, 3), all measured."""
    rng = np.random.default_rng(seed)
    factor = 0.01 * rng.standard_normal((people, 4, 3, 3))
    positions = rng.uniform(-1.0, 1.0, (people, 4, 3))
    return positions, factor @ np.swapaxes(factor, -1, -2), np.full((people, 4), MEASURED, np.uint8)


def test_a_length_is_a_scalar_measurement_of_both_ends():
    (positions, covariances, states), unknown = joints(1), np.full((1, 3), np.nan)
    lengths = unknown.copy()
    lengths[0, 0] = np.linalg.norm(positions[0, 1] - positions[0, 0]) + 0.02
    moved, tightened = positions.copy(), covariances.copy()
    pull_bones(moved, tightened, states, BONES, lengths, 0.01)
    unit = (positions[0, 1] - positions[0, 0]) / np.linalg.norm(positions[0, 1] - positions[0, 0])
    row = np.concatenate([-unit, unit])
    both = np.zeros((6, 6))
    both[:3, :3], both[3:, 3:] = covariances[0, 0], covariances[0, 1]
    expected = row @ both @ row
    total = expected + 0.01**2 * (1.0 + 0.02**2 / (9.0 * (expected + 0.01**2)))
    gain = both @ row / total
    assert np.allclose(moved[0, :2].ravel(), positions[0, :2].ravel() + gain * 0.02)
    whole = both - np.outer(gain, gain) * total
    assert np.allclose(tightened[0, 0], whole[:3, :3]) and np.allclose(tightened[0, 1], whole[3:, 3:])
    assert np.array_equal(moved[0, 2:], positions[0, 2:])
    assert np.array_equal(tightened[0, 2:], covariances[0, 2:])


def test_missing_joints_and_unknown_lengths_pull_nothing():
    positions, covariances, states = joints(2)
    states[0, 1] = MISSING
    moved = positions.copy()
    pull_bones(moved, covariances.copy(), states, BONES, np.full((1, 3), 5.0), 0.01)
    states[0, 1] = MEASURED
    pull_bones(moved, covariances.copy(), states, BONES, np.full((1, 3), np.nan), 0.01)
    assert np.array_equal(moved, positions)


def test_the_uncertain_end_moves():
    points = np.array([[[0, 0, 0], [0, 0, 0.36]]])
    spread = np.stack([1e-8 * np.eye(3), 0.03**2 * np.eye(3)])[None]
    tightened = spread.copy()
    pull_bones(points, tightened, np.full((1, 2), FILLED, np.uint8), BONES[:1], np.array([[0.3]]), 0.005)
    assert np.linalg.norm(points[0, 0]) < 1e-5 and 0.29 < points[0, 1, 2] < 0.32
    assert tightened[0, 1, 2, 2] < 0.1 * spread[0, 1, 2, 2]
    assert np.isclose(tightened[0, 1, 0, 0], spread[0, 1, 0, 0])


def test_errors_that_last_are_taken_off_bones_and_stay_in_covariances():
    model = SkeletonModel("arm", ("shoulder", "elbow"), 0, ((0, 1),), 0, bias_floors=(0.02, 0.02))
    found = {}
    for share in (0.0, 0.5):
        config = RefinementConfig(lasting_share=share, lag=0.12)
        stage, outputs = RefinementStage(config, StageContext(Rig(()), model)), []
        for index in range(200):
            off = 0.02 * np.sin(2.0 * np.pi * index / 50)  # of the elbow along the bone, for a second
            positions = np.array([[[0.0, 0.0, 1.4], [0.0, 0.3 + off, 1.4]]])
            outputs += stage.step(
                TrackedPoseSet(
                    index,
                    SECOND + index * SECOND // 50,
                    model.hash,
                    positions,
                    np.tile(4e-4 * np.eye(3), (1, 2, 1, 1)),
                    np.ones((1, 2)),
                    np.full((1, 2), 4),
                    np.full((1, 2), JointState.MEASURED),
                    np.ones(1),
                    ids=np.array([4]),
                )
            ).outputs
        lengths = [np.linalg.norm(item.positions[0, 1] - item.positions[0, 0]) for item in outputs[100:]]
        found[share] = np.std(lengths), np.trace(outputs[-1].covariances[0, 1])
    assert found[0.5][0] < 0.6 * found[0.0][0]
    assert found[0.5][1] > found[0.0][1] + 3 * 0.9 * 0.5 * 4e-4


def shaken(linked, dt=0.02, frames=20):
    """A bone of 0.3 m, one end of which shakes: places (F, 2, 3) m, and those that are taken at once."""
    people, bones, told = new_people([7], 2, 1), BONES[:1], []
    people.lengths[:], people.frames[:] = 0.3, 100.0
    states, small = np.full((1, 2), MEASURED, np.uint8), np.tile(1e-6 * np.eye(3), (1, 2, 1, 1))
    for frame in range(frames):
        places = np.array([[[0.0, 0.0, 0.0], [0.31 + 0.004 * (-1) ** frame, 0.0, 0.0]]])
        moment = unknown(SECOND, dt, 1, 2)
        moment.linked[:] = linked
        at_once = places.copy()
        pull_bones(at_once, 401.0 * small, states, bones, people.lengths.copy(), 0.01)
        judged = SmoothedJoints(places, small.copy(), np.ones((1, 2)), states)
        on_bones(judged, people, bones, (0.01, 10), 400.0 * small, moment)
        told.append((places[0], at_once[0]))
    return np.array(told).swapaxes(0, 1)


def test_what_bones_tell_of_errors_that_last_does_not_shake_neighbours():
    told, at_once = shaken(True)
    steps = [np.abs(np.diff(places[10:, 0, 0])).mean() for places in (told, at_once)]
    assert steps[0] < 0.4 * steps[1]
    middles = [places[10:, 0].mean(axis=0) for places in (told, at_once)]
    assert np.allclose(*middles, atol=5e-4) and middles[0][0] > 0.003  # what lasts is followed


def test_bones_of_joints_whose_surface_is_not_followed_are_taken_at_once():
    told, at_once = shaken(False)
    assert np.allclose(told, at_once, atol=2e-4)  # lengths are learnt a little further
