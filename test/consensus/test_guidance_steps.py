"""The compiled steps of the guidance against the numpy filter."""
import numpy as np
import pytest

from panoptic_ros.consensus.guidance import grown
from panoptic_ros.consensus.guidance_steps import predict_people, update_people
from panoptic_ros.geometry.motion import predict_motion, update_motion

DT, ACCELERATION = 0.04, 8.0
NOISE = ACCELERATION**2
GROWTH = (NOISE * DT**4 / 4.0, NOISE * DT**3 / 2.0, NOISE * DT**2)


def tables(rng, people=4, joints=5, groups=2):
    """Tables of people, a fifth of their joints unknown."""
    states = rng.normal(size=(people, joints, 6))
    states[rng.random((people, joints)) < 0.2] = np.nan
    variances = rng.uniform(1e-4, 0.05, (people, joints, 3)) * [1.0, 0.1, 1.0]
    ages = np.where(rng.random((people, joints)) < 0.5, 0.0, 0.1)
    unagreed, balance = rng.random((people, joints)), rng.normal(size=(people, groups))
    return states, variances, ages, rng.uniform(0.0, 0.4, people), unagreed, balance


@pytest.mark.parametrize("seed", range(6))
def test_moving_on_is_the_filters_prediction_and_forgetting(seed):
    given = tables(np.random.default_rng(seed))
    states, variances, ages, unseen, unagreed, balance = (table.copy() for table in given)
    states[..., 3:] *= np.where(ages > 0.0, 0.8, 1.0)[..., None]
    states, variances = predict_motion(states, variances, DT, ACCELERATION)
    states[variances[..., 0] > 0.04] = np.nan
    alive = (unseen + DT <= 0.3) & np.isfinite(states[..., 0]).any(axis=1)
    expected = (states, variances, ages + DT, unseen + DT, unagreed + DT, balance)
    got = predict_people(*given, DT, 0.8, GROWTH, 0.04, 0.3)
    for one, other in zip(got, expected):
        np.testing.assert_array_equal(one, other[alive])


@pytest.mark.parametrize("seed", range(6))
def test_taking_in_is_the_filters_update_with_new_people_last(seed):
    rng = np.random.default_rng(seed)
    given = tables(rng)
    who = np.array([2, -1, 0, -1])
    positions = rng.normal(size=(4, 5, 3))
    positions[rng.random((4, 5)) < 0.3] = np.nan
    covariances = rng.uniform(1e-5, 1e-3, (4, 5, 1, 1)) * np.eye(3)
    exchanged, firm = rng.normal(size=(4, 2)), rng.random((4, 5)) < 0.5
    fills = (np.nan, 0.0, 0.0, 0.0, np.inf, 0.0)
    states, variances, ages, unseen, unagreed, balance = (
        np.concatenate([table, np.full((2, *table.shape[1:]), fill)]) for table, fill in zip(given, fills)
    )
    rows = np.array([2, 4, 0, 5])
    noise = np.trace(covariances, axis1=-2, axis2=-1) / 3.0
    states[rows], variances[rows] = update_motion(states[rows], variances[rows], positions, noise, 1.5)
    ages[rows] = np.where(np.isfinite(positions[..., 0]), 0.0, ages[rows])
    unseen[rows] = 0.0
    unagreed[rows] = np.where(firm, 0.0, unagreed[rows])
    balance[rows] = 0.9 * balance[rows] + exchanged
    got = grown(given, 2)
    update_people(*got, who, positions, covariances, exchanged, firm, 1.5, 0.9)
    for one, other in zip(got, (states, variances, ages, unseen, unagreed, balance)):
        np.testing.assert_array_equal(one, other)
