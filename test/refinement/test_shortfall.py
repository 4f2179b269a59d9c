"""Motion of limbs that flow tells too small, against motions that are known."""

import captures
import numpy as np
import pytest

from panoptic_ros.domain import PartMotions
from panoptic_ros.domain.parts import rigid_parts
from panoptic_ros.geometry.rotations import rotation_of
from panoptic_ros.refinement.filter_bank import (
    MOST,
    PRIOR,
    add_motions,
    gains_of,
    in_full,
    learn_shortfall,
    limbs_of,
    nothing_compared,
    with_torso,
)
from panoptic_ros.refinement.links import JointDisplacements
from panoptic_ros.refinement.records import new_people

DT = 0.04
LIMBS = limbs_of(captures.SKELETON)
JOINTS = len(captures.SKELETON)


def learnt(share, noise=0.0, steps=500, seed=0):
    """Gains from limbs that swing, of which flow sees a share, and views all with white noise, m."""
    rng, people, sums = np.random.default_rng(seed), new_people([3, 5], JOINTS, 0), nothing_compared(LIMBS)
    phases = rng.uniform(0.0, 2.0 * np.pi, (2, JOINTS, 3))
    places = [
        0.1 * np.sin(5.0 * DT * step + phases) + noise * rng.normal(size=phases.shape)
        for step in range(steps)
    ]
    for step in range(1, steps):
        moved = 0.1 * (np.sin(5.0 * DT * step + phases) - np.sin(5.0 * DT * (step - 1) + phases))
        add_motions(people, share * moved, places[step] - places[step - 1], DT)
        learn_shortfall(sums, people, LIMBS.kinds, DT)
    return gains_of(sums), sums


def test_kinds_are_the_outer_joints_of_limbs_of_both_sides():
    names = captures.SKELETON.joint_names
    kinds = {frozenset(names[joint][1:] for joint in joints) for joints in LIMBS.kinds}
    assert kinds == {frozenset({name}) for name in ("Elbow", "Wrist", "Knee", "Ankle")}
    assert all(len(joints) == 2 for joints in LIMBS.kinds)
    assert rigid_parts(captures.SKELETON)[LIMBS.torso].name == "torso"


@pytest.mark.parametrize("share", [0.7, 0.85, 1.0])
def test_the_share_that_flow_sees_is_found(share):
    gains, sums = learnt(share)
    assert gains == pytest.approx((sums[:, 1] / share + PRIOR) / (sums[:, 1] + PRIOR), rel=0.02)
    assert gains == pytest.approx(1.0 / share, abs=0.1 * (1.0 / share - 1.0) + 1e-9)
    assert learnt(share, noise=0.01)[0] == pytest.approx(gains, abs=0.03)


def test_flow_is_never_made_smaller_nor_larger_without_bounds():
    assert gains_of(np.array([[0.1, 1.0], [9.0, 1.0], [0.0, 0.0]])) == pytest.approx([1.0, MOST, 1.0])


def test_joints_that_are_not_measured_begin_anew_and_tell_nothing():
    people, sums = new_people([3], JOINTS, 0), nothing_compared(LIMBS)
    moved = np.full((1, JOINTS, 3), 0.1)
    add_motions(people, moved, 2.0 * moved, DT)
    add_motions(people, moved, np.full_like(moved, np.nan), DT)
    assert not people.followed.any() and not people.seen.any()
    learn_shortfall(sums, people, LIMBS.kinds, DT)
    assert not sums.any()


def test_views_that_err_by_far_count_little():
    near, far = [], []
    for off, found in ((0.0, near), (1.0, far)):
        people, sums = new_people([3], JOINTS, 0), nothing_compared(LIMBS)
        moved = np.full((1, JOINTS, 3), 0.05)
        add_motions(people, moved, moved + off, DT)
        learn_shortfall(sums, people, LIMBS.kinds, DT)
        found.append(sums[:, 1])
    assert (far[0] < 0.01 * near[0]).all()


def test_places_move_with_the_torso_as_it_does():
    rng = np.random.default_rng(4)
    turn, centre, shift = 0.3 * rng.normal(size=3), rng.normal(size=3), rng.normal(size=3)
    motions = PartMotions(
        [7, 7],
        [LIMBS.torso, LIMBS.torso + 2],
        np.stack([centre, centre]),
        np.stack([turn, turn + 1.0]),
        np.stack([shift, shift + 1.0]),
        np.tile(np.eye(6), (2, 1, 1)),
        np.full(2, 9),
        np.ones(2),
    )
    places, rotation = rng.normal(size=(2, JOINTS, 3)), np.empty((3, 3))
    rotation_of(turn, rotation)
    moved = with_torso(motions, LIMBS.torso, [5, 7], places)
    assert np.isnan(moved[0]).all()
    assert places[1] + moved[1] == pytest.approx((places[1] - centre) @ rotation.T + centre + shift)


def test_limbs_move_against_the_torso_by_their_gain_and_the_rest_stays():
    rng = np.random.default_rng(5)
    links = JointDisplacements(rng.normal(size=(2, JOINTS, 3)), np.tile(np.eye(3), (2, JOINTS, 1, 1)))
    carried = rng.normal(size=(2, JOINTS, 3))
    carried[1] = np.nan  # a torso without a motion
    links.displacements[0, LIMBS.kinds[1][0]] = np.nan
    gains = np.array([1.2, 1.1, 1.0, 1.3])
    full = in_full(links, carried, LIMBS.kinds, gains).displacements
    expected = links.displacements.copy()
    for joints, gain in zip(LIMBS.kinds, gains):
        for joint in joints:
            own = links.displacements[0, joint] - carried[0, joint]
            expected[0, joint] = carried[0, joint] + gain * own
    assert full == pytest.approx(expected, nan_ok=True)
