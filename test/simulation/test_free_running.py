"""Captures of free-running cameras: every 2D joint is where the truth puts it at its own exposure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.errors import UsageError
from panoptic_ros.simulation.degradation import Degradation
from panoptic_ros.simulation.free_running import NOBODY, START_NS, FreeRunning, simulate_free_running
from panoptic_ros.simulation.free_running_scenes import FREE_RUNNING_SCENES, TOP_TEMPO
from panoptic_ros.simulation.skeleton import J

EXACT = Degradation(noise_px=0.0, hidden_miss=0.0)


def capture(name, seed=1, **changes):
    return simulate_free_running(replace(FREE_RUNNING_SCENES[name], **changes), seed)


def test_the_same_seed_gives_the_same_capture():
    first, again, other = (capture("visitors", seed, seconds=2.0).views for seed in (1, 1, 2))
    assert [one.view.stamp_ns for one in first] == [one.view.stamp_ns for one in again]
    assert all(np.array_equal(a.view.points, b.view.points, True) for a, b in zip(first, again))
    assert [one.view.stamp_ns for one in first] != [one.view.stamp_ns for one in other]


@pytest.mark.parametrize("name", ["crossing", "shutter"])
def test_joints_are_seen_where_the_truth_is_at_their_exposure(name):
    take = capture(name, seconds=2.0, degradation=EXACT)
    assert any(timing.line_s > 0.0 for timing in take.timings) == (name == "shutter")
    for one in take.views[::7]:
        camera, timing = take.rig.cameras[one.camera], take.timings[one.camera]
        for points, owner in zip(one.view.points, one.owners):
            there = np.flatnonzero(np.isfinite(points[:, 0]))
            times = one.seconds + timing.line_s * points[there, 1]
            truth = take.joints(times)[owner, np.arange(len(there)), there]
            assert np.allclose(camera.project(truth)[0], points[there], atol=1e-3)  # px


def test_stamps_invert_to_true_times():
    take = capture("clocks", seconds=2.0, timing=FreeRunning((25.0,), jitter_s=0.0, offset_s=0.05))
    offsets = np.array([timing.offset_s for timing in take.timings])
    assert offsets[0] == 0.0 and 0.01 < np.abs(offsets).max() <= 0.05
    for one in take.views:
        timing = take.timings[one.camera]
        shown = 1e-9 * (one.view.stamp_ns - START_NS)
        assert timing.offset_s + (1.0 + timing.drift) * shown == pytest.approx(one.seconds, abs=1e-8)


def test_staggered_cameras_are_evenly_apart_and_each_has_its_rate():
    take = capture(
        "staggered", seconds=2.0, timing=FreeRunning((12.5,), staggered=True, jitter_s=0.0, lost=0.0)
    )
    times = np.array([one.seconds for one in take.views])
    assert np.allclose(np.diff(times), 0.08 / 8)
    free = capture("free", seconds=4.0, timing=FreeRunning((25.0, 60.0), lost=0.0))
    counts = np.bincount([one.camera for one in free.views])
    assert counts == pytest.approx([100, 240, 100, 240], abs=1)


def test_tempo_grows_to_its_top():
    (person,) = capture("faster").people
    seconds = FREE_RUNNING_SCENES["faster"].seconds

    def speed(at):
        a, b = person.joints(np.array([at - 1e-4, at + 1e-4]))[:, J["BodyCenter"]]
        return np.linalg.norm((b - a)[:2]) / 2e-4

    assert speed(seconds) / speed(0.0) == pytest.approx(TOP_TEMPO, rel=0.15)  # the path is not a circle
    assert 0.7 < speed(0.0) < 1.2


def test_arms_swing_at_up_to_ten_metres_per_second():
    take = capture("free")
    times = np.arange(0.0, 10.0, 0.002)
    wrists = take.joints(times)[0, :, [J["lWrist"], J["rWrist"]]]
    speeds = np.linalg.norm(np.diff(wrists, axis=1), axis=-1) / 0.002
    assert 8.5 < speeds.max() < 12.0


def test_runners_pass_at_half_a_metre():
    take = capture("crossing")
    centres = take.joints(np.arange(0.0, 10.0, 0.01))[:, :, J["BodyCenter"], :2]
    assert np.linalg.norm(centres[0] - centres[1], axis=1).min() == pytest.approx(0.5, abs=0.02)


def test_six_people_enter_and_leave_at_a_distance():
    take = capture("visitors")
    times = np.arange(0.0, 20.0, 0.05)
    present = take.present(times)
    assert len(take.people) == 6 and (present.sum(0) >= 1).all()
    assert (np.diff(present.astype(int), axis=1) == 1).sum() == 4  # enter
    assert (np.diff(present.astype(int), axis=1) == -1).sum() == 5  # leave
    take = capture("visitors", seconds=4.0)
    for one in take.views:
        known = one.owners[one.owners != NOBODY]
        there = take.present(np.array([one.seconds]))[:, 0]
        assert there[known].all() and len(set(known.tolist())) == len(known)
    assert any((one.owners == NOBODY).any() for one in take.views)


def test_cameras_in_step_see_the_same_people():
    take = capture("staggered", seconds=0.5, degradation=EXACT)
    instants = list(take.in_step(70.0))
    assert len(instants) == 35 and len(instants[0][1]) == len(take.rig)
    seconds, views = instants[20]
    truth = take.joints(np.array([seconds]))[:, 0]
    for camera, seen in zip(take.rig.cameras, views):
        for points, sources in zip(seen.points, seen.sources):
            there = sources[:, 0] >= 0
            exact = camera.project(truth[sources[there, 0], sources[there, 1]])[0]
            assert np.allclose(exact, points[there], atol=1e-3)


def test_a_capture_without_duration_is_refused():
    with pytest.raises(UsageError, match="not 1 and 0 s"):
        capture("faster", seconds=0.0)
