"""Joints of two views, neither of which tells that the other errs."""

from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.graph.build import configure
from panoptic_ros.graph.pipeline import Pipeline
from panoptic_ros.simulation import simulate
from panoptic_ros.simulation.scenes import scene
from panoptic_ros.simulation.skeleton import SKELETON
from panoptic_ros.stage import StageContext


def unsmoothed(take, floor):
    """`PoseSet`s by the people of a detector with constant biases of so many m."""
    skeleton, found = replace(SKELETON, bias_floors=(floor,) * len(SKELETON)), []
    pipeline = Pipeline(
        configure({}),
        StageContext(take.rig, skeleton),
        ("association", "voting", "assembly"),
        on_record=lambda topic, record: found.append(record) if topic == "poses" else None,
    )
    for item in take.detection_sets(skeleton.hash):
        pipeline.push("detection_sets", item)
    pipeline.flush()
    return found


def test_those_of_a_detector_that_errs_for_long_are_less_certain_and_no_others():
    take = simulate(scene("three-views-2p"), 3, 40)
    growth = {2: [], 3: []}
    for plain, errs in zip(unsmoothed(take, 0.0)[-10:], unsmoothed(take, 0.02)[-10:], strict=True):
        assert np.allclose(plain.positions, errs.positions, equal_nan=True)
        ratio = np.trace(errs.covariances, axis1=-2, axis2=-1) / np.trace(
            plain.covariances, axis1=-2, axis2=-1
        )
        for views, own in growth.items():
            own += ratio[plain.views == views].tolist()
    two, three = np.array(growth[2]), np.array(growth[3])
    assert len(two) and len(three) and three == pytest.approx(np.ones(len(three)))
    assert (two >= 1.0 - 1e-9).all() and two.max() > 1.2
