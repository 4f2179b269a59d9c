"""Usual filters on motion that is known."""

import captures
import numpy as np
import patch_scene
import pytest

from panoptic_ros.evaluation.filtering import one_euro


def test_one_euro_takes_the_noise_of_who_stands_and_lags_behind_who_starts():
    joints = captures.people(0.0)[1]
    still = one_euro([patch_scene.skeletons(k, joints, noise=0.01) for k in range(60)])
    errors = [np.linalg.norm(item.positions[0] - joints, axis=1).mean() for item in still]
    assert np.mean(errors[20:]) < 0.8 * errors[0]
    step = one_euro([patch_scene.skeletons(k, joints + (k > 3) * 0.1) for k in range(5)])
    moved = step[4].positions[0] - joints
    assert ((moved > 0.02) & (moved < 0.1)).all()


def test_what_is_missing_is_held():
    joints = captures.people(0.0)[1]
    sets = [patch_scene.skeletons(k, joints, missing=(3,) if k else ()) for k in range(3)]
    assert one_euro(sets)[2].positions[0] == pytest.approx(joints)
