"""The paper's averaging against what it must do to exact motion."""

import captures
import numpy as np
import pytest

from panoptic_ros.domain import PartMotions
from panoptic_ros.domain.parts import rigid_parts
from panoptic_ros.refinement.averaging import averaged

PARTS = rigid_parts(captures.SKELETON)
WRIST = list(captures.SKELETON.joint_names).index("lWrist")
STEP = np.array([0.03, 0.0, 0.01])


def moving(count):
    positions = captures.people(0.0)[1]
    return [{7: positions + k * STEP} for k in range(count)]


def shifts(count, step=STEP):
    """Every part is measured to move so, from the second instant on."""
    number, nothing = len(PARTS), np.zeros((len(PARTS), 3))
    motions = PartMotions(
        np.full(number, 7),
        np.arange(number),
        nothing,
        nothing,
        np.tile(step, (number, 1)),
        np.tile(np.eye(6), (number, 1, 1)),
        np.full(number, 9),
        np.ones(number),
    )
    return [None] + [motions] * (count - 1)


def test_a_gap_is_filled_from_both_ends_one_instant_in_every_round():
    truth = moving(9)
    holes = [{7: own[7].copy()} for own in truth]
    for hole in holes[2:7]:
        hole[7][WRIST] = np.nan
    found, rounds = averaged(holes, lambda joints: shifts(9), captures.SKELETON)
    assert rounds == 4  # two from each end, the last instant, and one that fills nothing
    for own, true in zip(found, truth):
        assert own[7] == pytest.approx(true[7], abs=1e-12)


def test_what_no_motion_reaches_stays_missing_and_noise_is_averaged():
    truth, rng = moving(30), np.random.default_rng(0)
    noisy = [{7: own[7] + rng.normal(0.0, 0.02, own[7].shape)} for own in truth]
    for own in noisy:
        own[7][WRIST] = np.nan
    found, rounds = averaged(noisy, lambda joints: shifts(30), captures.SKELETON)
    assert rounds == 1 and all(np.isnan(own[7][WRIST]).all() for own in found)
    elbow = WRIST - 1
    errors = [
        [np.linalg.norm(own[7][elbow] - true[7][elbow]) for own, true in zip(all_of, truth)]
        for all_of in (noisy, found)
    ]
    assert np.mean(errors[1][1:-1]) < 0.7 * np.mean(errors[0][1:-1])
