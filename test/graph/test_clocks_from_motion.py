"""Clocks from motion with the real stages: recorded, and fed back into sync while it runs."""

from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.graph.build import configure
from panoptic_ros.graph.clocks_from_motion import find_clocks
from panoptic_ros.graph.nodes import AFTER_DETECTION
from panoptic_ros.graph.pipeline import Pipeline
from panoptic_ros.simulation import simulate
from panoptic_ros.simulation.scenes import scene
from panoptic_ros.simulation.skeleton import SKELETON
from panoptic_ros.stage import StageContext

LATE = np.array([0.0, 0.05, -0.04, 0.025, -0.055])  # s, what has to be added to the stamps


@pytest.fixture(scope="module")
def capture():
    """Runners and walkers for 2 s, every camera's stamps off by a constant."""
    take = simulate(scene("unsync-5v"), 3, 60)
    sets = [
        replace(
            item,
            views=tuple(
                replace(v, stamp_ns=v.stamp_ns - round(1e9 * LATE[take.rig.index(v.camera)]))
                for v in item.views
            ),
        )
        for item in take.detection_sets()
    ]
    return StageContext(take.rig, SKELETON), sets


def test_a_recording_with_stamps_off_by_tens_of_milliseconds(capture):
    context, sets = capture
    found = find_clocks(sets, context, configure({}), context.rig.names[0])
    np.testing.assert_allclose(found.clocks.offsets, LATE, atol=1.5e-3)
    assert found.clocks.applied[1:].all()
    assert len(found.sets) == len(sets)


def live(context, sets, active):
    """Stamps' corrections that sync made, and the skeletons' stamps."""
    settings = {"offsets": {"active": active, "block_s": 0.7, "trusted_camera": context.rig.names[0]}}
    moved, stamps, models = [], [], []

    def record(key, item):
        if key == "detection_sets":
            moved.append({v.camera: v.stamp_ns - raw[v.camera, v.frame_number] for v in item.views})
        elif key == "skeletons":
            stamps.append(item.stamp_ns)
        elif key == "clock_models":
            models.append((item.device, item.offset_ns, item.drift))

    pipeline = Pipeline(configure(settings), context, AFTER_DETECTION, on_record=record)
    views = sorted((v for item in sets for v in item.views), key=lambda v: (v.stamp_ns, v.camera))
    raw = {(v.camera, v.frame_number): v.stamp_ns for v in views}
    for view in views:
        pipeline.push("detections", view)
    for name in context.rig.names:
        pipeline.end("detections", name)
    pipeline.flush()
    return moved, stamps, models


def test_models_feed_back_into_sync_and_runs_repeat(capture):
    context, sets = capture
    moved, stamps, models = live(context, sets, active=True)
    assert all(shift == 0 for shift in moved[0].values())
    last = [moved[-1].get(name, 0) for name in context.rig.names]
    there = [name in moved[-1] for name in context.rig.names]
    np.testing.assert_allclose(1e-9 * np.array(last)[there], LATE[there], atol=2.5e-3)
    assert stamps == sorted(stamps)
    assert live(context, sets, active=True) == (moved, stamps, models)


def test_nothing_is_moved_unless_asked_for(capture):
    context, sets = capture
    moved, _, models = live(context, sets[:20], active=False)
    assert models == [] and all(shift == 0 for item in moved for shift in item.values())
