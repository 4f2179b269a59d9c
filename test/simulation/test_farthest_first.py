"""Cameras chosen farthest first: nested, spread, in the order of the rig."""

import numpy as np
import pytest

from panoptic_ros.errors import UsageError
from panoptic_ros.simulation import PanelDome, farthest_first

RIG = PanelDome(6).build(np.random.default_rng(0))


def test_choices_are_nested_and_spread():
    previous: set[str] = set()
    for count in (1, 4, 10, 40, 120):
        chosen = farthest_first(RIG, count)
        assert len(chosen) == count and previous <= set(chosen.names)
        assert list(chosen.names) == [name for name in RIG.names if name in set(chosen.names)]
        previous = set(chosen.names)
    centres = np.array([camera.centre for camera in farthest_first(RIG, 10).cameras])
    gaps = np.linalg.norm(centres[:, None] - centres[None], axis=-1) + 9.0 * np.eye(10)
    assert gaps.min() > 1.0  # of a dome of radius 2.7 m


def test_more_cameras_than_there_are_is_a_mistake():
    with pytest.raises(UsageError, match="121 cameras of a rig of 120"):
        farthest_first(RIG, 121)
