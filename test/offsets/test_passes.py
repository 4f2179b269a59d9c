"""Clocks of simulated captures."""

from dataclasses import replace

import numpy as np
import pytest
from rolling import with_line_delays

from panoptic_ros.domain import DetectionSet
from panoptic_ros.errors import UsageError
from panoptic_ros.graph.clocks_from_motion import ClockCorrection, find_clocks
from panoptic_ros.graph.recording import InMemoryRecording
from panoptic_ros.offsets import passes
from panoptic_ros.offsets.clocks import CameraClocks
from panoptic_ros.offsets.passes import MotionClocks, MotionClocksConfig
from panoptic_ros.offsets.regroup import regroup
from panoptic_ros.solving.spans import WINDOW_S, WINDOWS, telling_spans
from panoptic_ros.stage import StageContext, untold


def found(capture, trusted="", sets=None, tracked=None):
    """The clocks of a capture, or of other sets and tracked people, and the sets corrected by them."""
    sets = capture.sets if sets is None else sets
    people = capture.tracked if tracked is None else tracked
    work = MotionClocks(MotionClocksConfig(lambda items: people, trusted), capture.context)
    clocks = work.run(InMemoryRecording({"detection_sets": sets}), untold)
    return ClockCorrection(clocks, regroup(sets, clocks.corrections(sets)))


@pytest.fixture(scope="module")
def moving(make_capture):
    capture = make_capture()
    return capture, found(capture)


def test_offsets_of_tens_of_milliseconds_are_found_within_a_millisecond(moving):
    capture, result = moving
    clocks = result.clocks
    error = clocks.offsets - capture.offsets
    assert clocks.converged and clocks.known.all()
    assert np.abs(error - error.mean()).max() < 1e-3
    assert (np.abs(error - error.mean()) < 4.0 * clocks.deviations).all()


def test_corrected_frames_stand_where_they_belong(moving):
    capture, result = moving
    middle = result.sets[len(result.sets) // 2]
    assert len(middle.views) == len(capture.rig)
    for view in middle.views:
        c = capture.rig.index(view.camera)
        taken = int(capture.ticks[view.frame_number]) + 1e9 * (capture.offsets[c])
        assert abs(view.stamp_ns - taken) < 2e6
        assert abs(view.stamp_ns - middle.stamp_ns) <= 0.5e9 / 30.0 + 2e6


def test_two_cameras_off_leave_the_others_alone(make_capture):
    capture = make_capture(offsets=np.array([0.0, 0.08, 0.0, 0.0, -0.04]))
    clocks = found(capture).clocks
    np.testing.assert_allclose(clocks.offsets, capture.offsets, atol=1.5e-3)


def test_a_trusted_camera_keeps_its_stamps(make_capture):
    capture = make_capture()
    clocks = found(capture, capture.rig.names[0]).clocks
    assert clocks.offsets[0] == 0.0 and not clocks.applied[0]
    np.testing.assert_allclose(clocks.offsets, capture.offsets - capture.offsets[0], atol=1e-3)


def test_rows_of_known_line_delays_are_no_clock_offsets(make_capture):
    capture = make_capture(line_delays_us=(0.0, 30.0, 20.0), offsets=np.array([0.0, 0.02, 0.0, 0.0, -0.03]))
    error = found(capture).clocks.offsets - capture.offsets
    assert np.abs(error - error.mean()).max() < 1e-3
    global_shutters = StageContext(with_line_delays(capture.rig, (0.0,)), capture.skeleton)
    capture.context = global_shutters
    wrong = found(capture).clocks.offsets - capture.offsets
    assert np.abs(wrong - wrong.mean()).max() > 5e-3


def test_where_nothing_moves_nothing_is_known_and_stamps_stay(make_capture):
    capture = make_capture(motion=0.0, offsets=np.zeros(5))
    result = found(capture)
    assert not result.clocks.known.any() and not result.clocks.applied.any()
    for item, before in zip(result.sets, capture.sets):
        assert [v.stamp_ns for v in item.views] == [v.stamp_ns for v in before.views]


def test_a_clock_that_jumps_on_the_way_is_told_and_stands_in_the_deviations(make_capture):
    capture = make_capture(seconds=4.0)
    name, middle = capture.rig.names[1], len(capture.sets) // 2
    for i, item in enumerate(capture.sets[middle:], middle):
        views = tuple(later(view, 30e6) if view.camera == name else view for view in item.views)
        capture.sets[i] = replace(item, views=views)
    clocks = found(capture).clocks
    assert np.flatnonzero(clocks.strays).tolist() == [1] and 5e-3 < clocks.strays[1] < 30e-3
    assert clocks.deviations[1] >= clocks.strays[1] > 5.0 * clocks.deviations[[0, 2, 3, 4]].max()


def later(view, shift_ns):
    return replace(view, stamp_ns=view.stamp_ns + int(shift_ns))


def test_of_very_many_frames_some_of_every_camera_are_used(make_capture, monkeypatch):
    capture = make_capture()
    monkeypatch.setattr(passes, "MOST_FRAMES", len(capture.sets) * len(capture.rig) // 3)
    clocks = found(capture).clocks
    whole = 2 * len(capture.sets) * len(capture.skeleton)
    assert (clocks.rays > 0.2 * whole).all() and (clocks.rays < 0.4 * whole).all()
    error = clocks.offsets - capture.offsets
    assert np.abs(error - error.mean()).max() < 2e-3


def test_without_people_nothing_is_known(make_capture):
    capture = make_capture(seconds=0.5)
    result = found(capture, tracked=[])
    assert not result.clocks.known.any() and len(result.sets) == len(capture.sets)
    nothing = MotionClocks(MotionClocksConfig(lambda items: []), capture.context)
    assert not nothing.run(InMemoryRecording({}), untold).known.any()
    assert find_clocks([], capture.context, {}).sets == []


def test_views_that_are_missing_do_no_harm(make_capture):
    capture = make_capture()
    rng = np.random.default_rng(0)
    sets = [
        DetectionSet(s.index, s.stamp_ns, s.skeleton_hash, tuple(v for v in s.views if rng.random() < 0.7))
        for s in capture.sets
    ]
    clocks = found(capture, sets=sets).clocks
    error = clocks.offsets - capture.offsets
    assert np.abs(error - error.mean()).max() < 1.5e-3


def test_a_trusted_camera_that_the_rig_lacks_is_refused(make_capture):
    capture = make_capture(seconds=0.2)
    with pytest.raises(UsageError, match="nobody"):
        found(capture, "nobody")


def test_models_say_what_is_applied(moving):
    capture, result = moving
    clocks = result.clocks
    for c, model in enumerate(clocks.models()):
        assert model.device == capture.rig.names[c]
        shift = model.offset_ns + model.residual_ns
        assert shift == pytest.approx(1e9 * clocks.offsets[c] if clocks.applied[c] else 0.0, abs=1e-3)
        assert np.sqrt(model.covariance[0, 0]) == pytest.approx(clocks.deviations[c])


def test_unknown_clocks_correct_nothing(make_capture):
    capture = make_capture(seconds=0.2)
    clocks = CameraClocks.unknown(capture.rig.names, int(capture.ticks[0]))
    assert all((v == 0.0).all() for v in clocks.corrections(capture.sets).values())


def told(sets):
    """The sets that the clocks are estimated from."""
    stamps = np.array([item.stamp_ns for item in sets])
    people = np.array([sum(len(view.points) for view in item.views) for item in sets])
    return [s for begin, end in telling_spans(stamps, people) for s in sets if begin <= s.stamp_ns < end]


def test_of_an_hour_some_windows_with_people_tell(make_capture):
    few = make_capture(seconds=0.2).sets
    second = 1_000_000_000
    hour = [
        DetectionSet(i, i * second, few[0].skeleton_hash, few[0].views if i % 300 >= 200 else ())
        for i in range(3600)
    ]
    part = told(hour)
    assert len(part) == WINDOWS * WINDOW_S and all(item.views for item in part)
    stamps = [item.stamp_ns for item in part]
    assert stamps == sorted(set(stamps)) and stamps[-1] - stamps[0] > 3000 * second
    assert told(hour[:40]) == hour[:40]


def test_biased_joints_make_the_deviations_larger(make_capture):
    plain, biased = make_capture(), make_capture(bias_px=8.0)
    exact, loose = found(plain).clocks, found(biased).clocks
    assert exact.bias == 0.0 and loose.bias > 0.005
    assert (loose.deviations > 3.0 * exact.deviations).all()
    error = loose.offsets - biased.offsets
    assert np.sqrt(np.mean((error - error.mean()) ** 2)) < 3.0 * np.sqrt(np.mean(loose.deviations**2))
