"""Local misfits of a body model."""

import numpy as np
import pytest
from free_cameras import FreeCapture

from panoptic_ros.continuous.config import ContinuousConfig
from panoptic_ros.continuous.misfits import SHARE, local_misfits
from panoptic_ros.continuous.passes import ContinuousPass
from panoptic_ros.stage import untold

JOINTS = np.array([3, 5])


@pytest.fixture(scope="module")
def person():
    capture = FreeCapture(seconds=2.0)
    return ContinuousPass(ContinuousConfig(), capture.context).run(capture.recording, untold).people[0]


def test_a_model_that_fits_has_none_and_one_that_misses_has_its_square(person):
    times = np.linspace(0.3 + person.seen[0], person.seen[-1] - 0.3, 200)
    places, spreads = person.at(times)[:, JOINTS], 0.5 * person.covariances_at(times)[:, JOINTS]
    assert (local_misfits(person, times, JOINTS, places, spreads) == 0.0).all()
    missed = places.copy()
    missed[100:, 1, 0] += 0.03
    found = local_misfits(person, times, JOINTS, missed, spreads)
    assert (found[:, 0] == 0.0).all() and (found[:40, 1] == 0.0).all()
    rest = SHARE * np.trace(spreads[150, 1])  # the model's covariance is half of the curve's
    assert found[150, 1] == pytest.approx((0.03**2 - rest) / 3.0, rel=0.05)


def test_instants_beyond_the_curve_have_none(person):
    times = person.seen[-1] + np.linspace(0.5, 1.0, 20)
    places = np.zeros((20, 2, 3))
    spreads = np.zeros((20, 2, 3, 3))
    assert (local_misfits(person, times, JOINTS, places, spreads) == 0.0).all()
