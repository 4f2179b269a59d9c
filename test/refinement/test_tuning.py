"""Learning from innovations: motions and noise of known strength."""

import numpy as np
import pytest

from panoptic_ros.domain import Rig, SkeletonModel, TrackedPoseSet
from panoptic_ros.refinement.config import RefinementConfig
from panoptic_ros.refinement.links import JointDisplacements, predict_linked
from panoptic_ros.refinement.motion_model import SIX, transition
from panoptic_ros.refinement.records import MotionStates, new_people
from panoptic_ros.refinement.stage import RefinementStage
from panoptic_ros.refinement.tuning import (
    innovation_sums,
    learn,
    learn_turns,
    nothing_lasting,
    process_noise,
    scales,
)
from panoptic_ros.stage import StageContext

JOINTS, RATE = 30, 30.0
NAMES = tuple(f"joint {i}" for i in range(JOINTS))
MODEL = SkeletonModel("cloud", NAMES, 0, tuple((0, i) for i in range(1, JOINTS)), 0)


def refined(process, sigma=0.01, stated=None, lasting=0.0, count=150):
    """Mean squared normalised error and error in sigmas of joints that accelerate at random, after a while.

    process: m^2/s^3. sigma, stated: m, true and stated noise. lasting: correlation from frame to frame.
    """
    rng, dt = np.random.default_rng(0), 1.0 / RATE
    stage = RefinementStage(RefinementConfig(bone_sigma=0.0), StageContext(Rig(()), MODEL))
    step = np.linalg.cholesky(process * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]))
    places, speeds = np.zeros((JOINTS, 3)), np.zeros((JOINTS, 3))
    noise = sigma * rng.standard_normal((JOINTS, 3))
    ones, truth, outputs = np.ones((1, JOINTS)), [], []
    covariances = np.tile((stated or sigma) ** 2 * np.eye(3), (1, JOINTS, 1, 1))
    for index in range(count):
        kick = (step @ rng.standard_normal((2, 3 * JOINTS))).reshape(2, JOINTS, 3)
        places, speeds = places + dt * speeds + kick[0], 0.98 * speeds + kick[1]
        fresh = np.sqrt(1.0 - lasting**2) * sigma * rng.standard_normal((JOINTS, 3))
        noise = lasting * noise + fresh
        truth.append(places)
        item = TrackedPoseSet(
            index,
            round(1e9 * index * dt),
            MODEL.hash,
            (places + noise)[None],
            covariances,
            ones,
            4 * ones,
            ones,
            np.ones(1),
            ids=[0],
        )
        outputs += stage.step(item).outputs
    squares, errors = [], []
    for output in outputs[80:]:
        offset = output.positions[0] - truth[output.index]
        squares.append(np.einsum("ji,jik,jk->j", offset, np.linalg.inv(output.covariances[0]), offset) / 3.0)
        errors.append(np.linalg.norm(offset, axis=-1) / sigma)
    return np.mean(squares), np.mean(errors)


@pytest.mark.parametrize("process", [0.05, 0.5, 2.0])
@pytest.mark.parametrize("stated", [0.007, 0.01, 0.02])
def test_covariances_are_honest_whatever_the_motion_and_the_stated_noise(process, stated):
    squares, _ = refined(process, stated=stated)
    assert 0.8 < squares < 1.35


def test_quiet_joints_are_smoothed_more():
    assert refined(0.02)[1] < 0.8 * refined(1.0)[1]


def test_errors_that_last_are_noticed():
    assert refined(0.05, lasting=0.5)[0] < 1.8


def correlated(rng, value, correlation):
    """The next of innovations whose neighbours have this correlation."""
    return correlation * value + np.sqrt(1.0 - correlation**2) * rng.standard_normal(value.shape)


def test_factors_follow_the_sign_of_the_correlation():
    people, rng = new_people([7, 3], JOINTS, 0), np.random.default_rng(0)
    value = rng.standard_normal((2, JOINTS, 3))
    for _ in range(30):
        value[0], value[1] = correlated(rng, value[0], 0.5), correlated(rng, value[1], -0.5)
        learn(people, np.ones(2, bool), value, nothing_lasting())
    assert (people.factors[0] > 1.3).all() and (people.factors[1] < 0.75).all()


def test_levels_follow_the_size_of_innovations_and_those_who_are_not_seen_learn_nothing():
    people, rng, lasting = new_people([7, 3], JOINTS, 0), np.random.default_rng(0), nothing_lasting()
    for _ in range(500):
        learn(people, np.array([True, False]), 0.5 * rng.standard_normal((2, JOINTS, 3)), lasting)
    assert np.isclose(scales(people, lasting)[0], 0.25, atol=0.02)
    assert people.levels[1] == 1.0 and np.all(people.factors[1] == 1.0)
    assert np.isnan(people.innovations[1]).all()


def test_errors_that_last_make_everybody_less_certain():
    people = new_people([7, 3], JOINTS, 0)
    assert np.array_equal(scales(people, np.array([100.0, 0.0])), [1.0, 1.0])
    assert np.allclose(scales(people, np.array([100.0, -0.16])), 1.8)


def test_speeds_are_against_the_median_velocity():
    states = np.random.default_rng(0).standard_normal((2, 7, 6))
    states[0, 2], states[1] = np.nan, np.nan
    speeds, noise = np.full((2, 7), 0.5), np.empty((2, 7))
    factors = np.random.default_rng(1).uniform(0.5, 2.0, (2, 7))
    process_noise(speeds, factors, states, 0.1, 4.0, noise)
    known = np.arange(7) != 2
    against = np.linalg.norm(states[0, :, 3:] - np.median(states[0, known, 3:], axis=0), axis=1)
    assert np.allclose(speeds[0, known], np.clip(against, 0.5, 3.0)[known])
    assert speeds[0, 2] == 0.5 and (speeds[1] == 0.5).all()
    assert np.allclose(noise, factors * (0.1 + 4.0 * speeds**2))


def test_sums_are_those_of_numpy():
    rng = np.random.default_rng(0)
    now, before = 2.0 * rng.standard_normal((8, 3)), 2.0 * rng.standard_normal((3, 8, 3))
    now[2] = before[0, 4] = before[2, 5] = np.nan
    count, square, next_sum, late_sum = innovation_sums(now, before)
    a, b = np.clip(now, -3, 3), np.clip(before, -3, 3)
    assert count == 7 and np.isclose(square, np.nansum(a**2))
    assert np.isclose(next_sum, np.nansum(a * b[0])) and np.isclose(late_sum, np.nansum(a * (b[1:])))


@pytest.mark.parametrize(("process", "stated"), [(0.5, 0.001), (0.05, 0.001), (0.1, 0.002)])
def test_process_noise_is_learnt_from_displacements_as_their_true_noise_asks(process, stated):
    """What counts is the ratio of both noises: where that of displacements is stated too large, so is it."""
    rng, dt, sigma = np.random.default_rng(1), 1.0 / RATE, 0.001
    step = np.linalg.cholesky(process * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]))
    people, speeds = new_people([7], JOINTS, 0), np.zeros((JOINTS, 3))
    shape, factors = (1, JOINTS), []
    motion = MotionStates(np.zeros((*shape, 6)), np.tile(0.1 * np.eye(6), (*shape, 1, 1)))
    for _ in range(300):
        kick = (step @ rng.standard_normal((2, 3 * JOINTS))).reshape(2, JOINTS, 3)
        moved = dt * speeds + kick[0] + sigma * rng.standard_normal((JOINTS, 3))
        speeds = 0.98 * speeds + kick[1]
        links = JointDisplacements(moved[None], np.tile(stated**2 * np.eye(3), (*shape, 1, 1)))
        ahead = MotionStates(np.empty_like(motion.states), np.empty_like(motion.covariances))
        turns, gains = np.full((*shape, 3), np.nan), np.empty((*shape, 6, 6))
        noise = 0.1 * people.factors
        predict_linked(SIX, motion, transition(dt, 0.0), noise, links, 1e9, ahead, gains, turns)
        learn_turns(people, turns, dt)
        motion = ahead
        factors.append(np.exp(np.log(people.factors).mean()))
    wanted = process / 0.1 * (stated / sigma) ** 2
    # less, as people move more smoothly than this
    assert 0.25 < np.exp(np.log(factors[100:]).mean()) / wanted < 1.5


def test_positions_do_not_tell_the_process_noise_of_joints_of_which_displacements_tell_it():
    people, same = new_people([1], JOINTS, 0), np.ones((1, JOINTS, 3))
    turns = np.ones((1, JOINTS, 3))
    turns[0, 5:] = np.nan
    learn_turns(people, turns, 1.0 / RATE)
    for _ in range(20):
        learn(people, np.ones(1, bool), same, nothing_lasting())
    assert np.all(people.factors[0, :5] == 1.0) and np.all(people.factors[0, 5:] > 2.0)


def test_a_joint_that_swings_gets_more_process_noise_than_those_that_stand():
    people, rng = new_people([7], JOINTS, 0), np.random.default_rng(0)
    value = rng.standard_normal((1, JOINTS, 3))
    for _ in range(60):
        value[0, :5] = correlated(rng, value[0, :5], 0.8)
        value[0, 5:] = correlated(rng, value[0, 5:], -0.3)
        learn_turns(people, value, 0.04)
    assert people.factors[0, :5].min() > 2.0 * people.factors[0, 5:].max()


def test_the_same_correlation_asks_for_less_process_noise_where_images_follow_each_other_quickly():
    means = []
    for dt in (0.04, 0.0125):
        people, rng = new_people([7], JOINTS, 0), np.random.default_rng(0)
        value = rng.standard_normal((1, JOINTS, 3))
        for _ in range(60):
            value = correlated(rng, value, 0.4)
            learn_turns(people, value, dt)
        means.append(people.factors.mean())
    assert means[1] < 0.7 * means[0]
