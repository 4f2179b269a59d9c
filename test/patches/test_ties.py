"""Parts that hang together: a limb is corrected by the part that carries it."""

import captures
import numpy as np
import patch_scene
import pytest

from panoptic_ros.patches.motions import PartConnections

NAMES = [part.name for part in patch_scene.PARTS]
TORSO, ARM, FOREARM = (NAMES.index(name) for name in ("torso", "lShoulder-lElbow", "lElbow-lWrist"))
JOINTS = captures.person((0.0, 0.0), 0.4)
SHOULDER, ELBOW = captures.SKELETON.joint("lShoulder"), captures.SKELETON.joint("lElbow")
TIES = PartConnections(patch_scene.PARTS)


def test_every_limb_hangs_on_one_part_that_comes_before_it():
    seen = {TORSO}
    for above, part, joint in TIES.of:
        assert above in seen and joint in patch_scene.PARTS[above].joints
        seen.add(part)
    assert len(TIES.of) == len(seen) - 1 == sum(part.is_limb for part in patch_scene.PARTS)


def corrected(shift, spread_above=1e-8, spread=1e-2):
    """Torso moves by a shift (3,), the arm is said to stay; both motions and covariances afterwards."""
    centres = np.array([JOINTS[SHOULDER], JOINTS[ELBOW]])
    motions, covariances = np.zeros((2, 6)), np.array([spread_above * np.eye(6), spread * np.eye(6)])
    motions[0, 3:] = shift
    TIES.correct({TORSO: 0, ARM: 1}, JOINTS, centres, motions, covariances)
    return motions, covariances, centres


def test_an_uncertain_limb_goes_along_at_the_joint():
    shift = np.array([0.02, 0.01, -0.01])
    motions, covariances, centres = corrected(shift)
    arm = JOINTS[SHOULDER] - centres[1]
    moved = motions[1, 3:] + np.cross(motions[1, :3], arm)  # to first order
    assert moved == pytest.approx(shift, abs=5e-4)
    assert motions[0, 3:] == pytest.approx(shift) and np.trace(covariances[1]) < 0.05


def test_a_limb_that_is_known_well_stays():
    motions, _, _ = corrected(np.array([0.002, 0.0, 0.0]), spread_above=1e-2, spread=1e-8)
    assert motions[1] == pytest.approx(np.zeros(6), abs=1e-6)


def test_contradiction_makes_uncertain():
    _, agreeing, _ = corrected(np.zeros(3), 1e-6, 1e-6)
    _, against, _ = corrected(np.array([0.1, 0.0, 0.0]), 1e-6, 1e-6)
    assert np.trace(against[1]) > 10.0 * np.trace(agreeing[1])


def test_unknown_joints_and_missing_parts_change_nothing():
    motions, covariances = np.ones((1, 6)), np.eye(6)[None].copy()
    TIES.correct({ARM: 0}, JOINTS, np.zeros((1, 3)), motions, covariances)
    lost = JOINTS.copy()
    lost[SHOULDER] = np.nan
    both = np.ones((2, 6))
    TIES.correct({TORSO: 0, ARM: 1}, lost, np.zeros((2, 3)), both, np.tile(np.eye(6), (2, 1, 1)))
    assert (motions == 1.0).all() and (both == 1.0).all()
