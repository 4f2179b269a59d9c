"""A camera that turns or zooms is named by its own past, and no other camera is."""

import captures
import numpy as np
import pytest
import walkers

from panoptic_ros.domain import AssociationSet
from panoptic_ros.geometry.rotations import vectors_of
from panoptic_ros.graph.build import configure, make_stage
from panoptic_ros.graph.pipeline import Pipeline
from panoptic_ros.health.past import WINDOW, PastSums, change_of

CAMERAS = captures.RIG.cameras
EVENT_S = 14.0
SOON_S = 6.0


def told(items, **values):
    """Times (s) and notices, and all rigs."""
    stage = make_stage("health", configure({"health": values})["health"], captures.CONTEXT)
    notices, rigs = [], []
    for item in items:
        result = stage.step(item)
        notices += [(1e-9 * item.stamp_ns, notice) for notice in result.notices]
        rigs += result.outputs
    return notices, rigs


def after(camera, changed, seconds=30.0):
    """Return items of a walk during which a camera changes."""
    others = list(CAMERAS)
    others[camera] = changed
    return walkers.walk(seconds, ((EVENT_S, tuple(others)),))


@pytest.mark.parametrize("camera", range(4))
def test_a_tilt_of_a_fifth_of_a_degree_is_named_within_six_seconds(camera):
    notices, rigs = told(after(camera, walkers.turned(CAMERAS[camera], (0.14, -0.14, 0.0))))
    time_s, _ = notices[0]
    assert EVENT_S < time_s <= EVENT_S + SOON_S
    assert {(n.code, n.values["device"]) for _, n in notices} == {
        ("health.turned", captures.RIG.names[camera])
    }
    assert not rigs


def test_a_turn_about_the_optical_axis_is_named_once_the_past_is_known_well():
    others = (*CAMERAS[:2], walkers.turned(CAMERAS[2], (0.0, 0.0, 0.4)), CAMERAS[3])
    notices, _ = told(walkers.walk(33.0, ((26.0, others),)))
    assert 26.0 < notices[0][0] <= 26.0 + SOON_S
    assert {(n.code, n.values["device"]) for _, n in notices} == {("health.turned", "cam2")}


def test_what_people_scatter_widens_the_limit():
    rng = np.random.default_rng(2)
    tests = {}
    for scatter in (1e-4, 3e-3):
        sums = PastSums(1)
        for block in range(120):
            slopes = 4e2 * rng.standard_normal((30, 4))
            parameters = scatter * rng.standard_normal(4) + (0.003 if block >= 110 else 0.0)
            sums.normals[0] = 3.0 * slopes.T @ slopes
            sums.vectors[0] = sums.normals[0] @ parameters
            sums.frames[0] = 3
            sums.close(1.0)
        tests[scatter] = sums.tests[0]
    assert tests[3e-3] < 0.1 * tests[1e-4]


def test_a_zoom_is_named_as_such():
    notices, _ = told(after(2, walkers.zoomed(CAMERAS[2], 1.01)))
    assert {(n.code, n.values["device"]) for _, n in notices} == {("health.zoomed", "cam2")}


def test_repair_gives_the_rig_with_the_camera_as_it_is():
    true = walkers.turned(CAMERAS[1], (0.4, 0.3, 0.0))
    notices, rigs = told(after(1, true), repair=True)
    assert [notice.code for _, notice in notices][:2] == ["health.turned", "health.repaired"]
    left = rigs[0].cameras[1].cam_from_world.rotation @ true.cam_from_world.rotation.T
    assert np.rad2deg(np.linalg.norm(vectors_of(np.ascontiguousarray(left[None])))) < 0.1
    assert np.allclose(rigs[0].cameras[1].centre, CAMERAS[1].centre)
    assert rigs[0].cameras[0] is CAMERAS[0]


def test_the_pipeline_goes_on_with_the_corrected_rig():
    pipeline = Pipeline(configure({"health": {"repair": True}}), captures.CONTEXT, ("health",))
    before = pipeline.stage("health")
    for item in after(1, walkers.turned(CAMERAS[1], (0.4, 0.3, 0.0)), 26.0):
        pipeline.push("associations" if isinstance(item, AssociationSet) else "skeletons_raw", item)
    now = pipeline.stage("health")
    assert now is not before
    assert now._rig.cameras[1] is not CAMERAS[1]


def test_nobody_is_named_without_a_change_or_without_walking():
    assert told(walkers.walk(40.0)) == ([], [])
    others = (walkers.turned(CAMERAS[0], (0.0, 1.0, 0.0)), *CAMERAS[1:])
    assert told(walkers.walk(30.0, ((EVENT_S, others),), still=True)) == ([], [])


def test_a_calibration_that_was_wrong_from_the_start_is_no_change():
    others = (walkers.turned(CAMERAS[0], (0.0, 0.5, 0.0)), *CAMERAS[1:])
    assert told(walkers.walk(30.0, ((0.0, others),))) == ([], [])


def sums_of(change, past=(0.0, 0.0, 0.0, 0.0)):
    """Sums of one camera whose joints fit `past`, then `past` + `change`, without noise."""
    rng = np.random.default_rng(1)
    sums = PastSums(1)
    for block in range(6 * WINDOW):
        slopes = 4e2 * rng.standard_normal((30, 4))
        parameters = np.add(past, change) if block >= 4 * WINDOW else np.array(past)
        sums.normals[0], sums.vectors[0] = slopes.T @ slopes, slopes.T @ slopes @ parameters
        sums.normals[0] *= 3.0
        sums.vectors[0] *= 3.0
        sums.frames[0] = 3
        sums.close(1.0)
    return sums


@pytest.mark.parametrize("past", [(0.0, 0.0, 0.0, 0.0), (0.004, -0.002, 0.001, 0.003)])
def test_the_change_is_that_against_the_past(past):
    turn = change_of(sums_of((0.003, 0.0, -0.002, 0.0), past), 0)
    assert not turn.is_zoom
    assert np.allclose(turn.change, (0.003, 0.0, -0.002), atol=2e-4)
    zoom = change_of(sums_of((0.0, 0.0, 0.0, 0.01), past), 0)
    assert zoom.is_zoom
    assert zoom.change == pytest.approx(0.01, rel=0.05)
    assert zoom.agreed == pytest.approx(1.0, abs=0.1)
