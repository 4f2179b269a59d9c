"""Noise of 2D joints: medians of the groups, one after the other."""

import numpy as np

from panoptic_ros.solving.joint_noise import LEAST_COUNT, RAYLEIGH_MEDIAN, JointNoiseModel


def test_factors_are_medians_of_their_groups():
    rng = np.random.default_rng(0)
    count = 1000
    cameras = np.repeat([0, 1, 2], [600, 400 - LEAST_COUNT // 2, LEAST_COUNT // 2])
    joints, scores = rng.integers(0, 4, count), rng.uniform(0.3, 1.0, count)
    model = JointNoiseModel(cameras, joints, scores, 1e-3)
    ratios = rng.rayleigh(1.0 + cameras)
    usable = rng.uniform(size=count) < 0.9
    left = ratios.copy()
    for group, factors in zip(((scores * 5).astype(int), cameras, joints), [f.copy() for f in model.factors]):
        for k in range(len(factors)):
            own = left[usable & (group == k)]
            if len(own) >= LEAST_COUNT:
                left[group == k] /= np.median(own) / RAYLEIGH_MEDIAN
    before = model.sigmas()
    model.learn(ratios, usable)
    np.testing.assert_allclose(model.sigmas() / before, ratios / left, rtol=1e-12)
    assert model.factors[1][2] == 1.0  # too few residuals
