"""Sums over headings and offsets are those of turning and comparing one by one."""

import numpy as np
import pytest

from panoptic_ros.geometry.rotations import turn_about_z
from panoptic_ros.kinematics.imus.turned_sums import compare_turned


@pytest.mark.parametrize("heading", [0.0, 1.1, -2.7])
def test_sums_are_those_of_turned_vectors(heading):
    rng = np.random.default_rng(2)
    when, stamps = np.cumsum(rng.integers(5, 20, size=60)), np.arange(100, 400, 17)
    vectors, goals = rng.normal(size=(60, 3)), rng.normal(size=(len(stamps), 3))
    vectors[30:33] = np.nan
    halves = rng.normal(size=(len(stamps), 3, 3))
    information, offsets = halves @ halves.swapaxes(1, 2), np.array([-40.0, 0.0, 12.5])
    turn, found = np.array([np.cos(heading), np.sin(heading)]), []
    for offset in offsets:
        there = np.stack([np.interp(stamps - offset, when, vectors[:, j]) for j in range(3)], axis=-1)
        known = np.isfinite(there).all(-1)
        left = (goals - there @ turn_about_z(heading).T)[known]
        found.append((np.einsum("ti,tij,tj->", left, information[known], left), known.sum()))
    seen = stamps, goals, information
    matrices, pulls, constants, numbers = compare_turned((when, vectors), seen, offsets)
    sums = turn @ matrices @ turn - 2.0 * pulls @ turn + constants
    assert sums == pytest.approx([total for total, _ in found]) and (numbers == [n for _, n in found]).all()
