"""What is left out is out, and nothing else."""

import numpy as np

from panoptic_ros.kinematics.pose.prior import PoseStatistics
from panoptic_ros.study.bodies.cases import BodyCase
from panoptic_ros.study.bodies.terms import (
    FULL,
    without_deviation,
    without_projection,
)
from panoptic_ros.study.names import parsed

RNG = np.random.default_rng(0)
PRIOR = PoseStatistics(
    np.zeros(9), np.linalg.qr(RNG.normal(size=(9, 4)))[0], RNG.uniform(0.1, 1.0, 4), RNG.uniform(0.1, 1.0, 9)
)
CASE = BodyCase("", 0, None, (), (), PRIOR)


def test_each_part_of_the_prior_is_left_out_alone():
    free = without_projection(CASE).statistics
    np.testing.assert_allclose(free.projection, 0.0, atol=1e-9)
    np.testing.assert_allclose(free.deviation, PRIOR.deviation, atol=1e-9)
    np.testing.assert_allclose(free.measured_in(PRIOR.spreads)[0], 0.0, atol=1e-9)
    free = without_deviation(CASE).statistics
    np.testing.assert_allclose(free.deviation, 0.0, atol=1e-9)
    np.testing.assert_allclose(free.projection, PRIOR.projection)


def test_changes_are_told_against_all_terms():
    scores = {"method": "ours", "change": FULL, "mm": 10.0, "relative_mm": 9.0, "deg": 5.0} | {
        "acc": 1.0,
        "inside": 0.9,
    }
    less = scores | {"change": "no prior", "mm": 15.0, "deg": 4.0}
    rows = [row | {"method": m} for m in ("ours", "malleson-2020") for row in (scores, less)]
    lines = list(parsed("terms", []).lines({"rows": rows}))
    assert lines[3].split()[-4:] == ["+50", "%,", "-20", "%"]
