"""Correction of made people."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from panoptic_ros.domain import BiasTable
from panoptic_ros.errors import ConfigError

BODY = np.array([[0.0, 0.2, 1.4], [0.0, -0.2, 1.4], [0.0, 0.15, 0.9], [0.0, -0.15, 0.9], [0.1, 0.0, 1.6]])


def table(offsets):
    return BiasTable("made", offsets, (0, 1, 2, 3))


def test_offsets_are_forward_left_up_in_torso_lengths():
    offsets = np.zeros((5, 3))
    offsets[4] = 0.1, 0.2, -0.4
    moved = table(offsets).corrected(np.stack([BODY, 2.0 * BODY]))
    assert np.allclose(moved[0] - BODY, [[0, 0, 0]] * 4 + [[0.05, 0.1, -0.2]])
    assert np.allclose(moved[1] - 2.0 * BODY, [[0, 0, 0]] * 4 + [[0.1, 0.2, -0.4]])


def test_turned_people_get_turned_offsets():
    offsets = np.random.default_rng(0).normal(0, 0.05, (5, 3))
    turn = Rotation.from_rotvec([0.3, -0.5, 2.0]).as_matrix()
    straight = table(offsets).corrected(BODY[None])[0]
    assert np.allclose(table(offsets).corrected((BODY @ turn.T)[None])[0], straight @ turn.T)


def test_people_without_a_whole_torso_and_missing_joints_stay():
    people = np.stack([BODY, BODY])
    people[0, 2], people[1, 4] = np.nan, np.nan
    moved = table(np.full((5, 3), 0.1)).corrected(people)
    assert np.array_equal(moved[0], people[0], equal_nan=True)
    assert np.isnan(moved[1, 4]).all() and np.isfinite(moved[1, :4]).all()
    assert not np.allclose(moved[1, :4], people[1, :4])


@pytest.mark.parametrize("value", [np.nan, np.inf, 1.0])
def test_offsets_that_cannot_be_are_refused(value):
    with pytest.raises(ConfigError, match="made"):
        table(np.full((5, 3), value))
