"""The study `continuous`: its figures on results with known faults, and its methods on a short capture."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from study_runs import run_named

from panoptic_ros.continuous.config import ContinuousConfig
from panoptic_ros.evaluation import SkeletonFrame
from panoptic_ros.simulation.free_running import START_NS, simulate_free_running
from panoptic_ros.simulation.free_running_scenes import FREE_RUNNING_SCENES
from panoptic_ros.study.continuous.continuous import Continuous
from panoptic_ros.study.continuous.figures import LINGER_S, figures_of
from panoptic_ros.study.continuous.methods import LAGS, METHODS, CaptureUnderTest, rendered_frames
from panoptic_ros.study.names import parsed

TIMES = np.arange(1, 800) / 100.0  # s


@pytest.fixture(scope="module")
def visitors():
    return simulate_free_running(replace(FREE_RUNNING_SCENES["visitors"], seconds=8.0), 1)


def perfect(take, times=TIMES, shift=0.0, linger=0.0):
    """The true people, moved by `shift` m, some of whom stay `linger` s too long."""
    joints, frames = take.joints(times) + [shift, 0.0, 0.0], []
    there = take.present(times) | take.present(times - linger)
    for t, seconds in enumerate(times):
        rows = np.flatnonzero(there[:, t])
        covariances = np.broadcast_to(1e-4 * np.eye(3), (len(rows), 19, 3, 3))
        frames.append(SkeletonFrame(START_NS + round(1e9 * seconds), rows, joints[rows, t], covariances))
    return frames


def test_errors_are_those_of_the_result(visitors):
    found = figures_of(visitors, TIMES, perfect(visitors, shift=0.02))
    assert found["mean_m"] == pytest.approx(0.02) and found["last_m"] == pytest.approx(0.02)
    assert found["p95_m"] == pytest.approx(0.02) and found["by_speed_m"][0] == pytest.approx(0.02)
    assert found["in_ellipsoid"] == 1.0 and found["output"] == 1.0  # sd of 1 cm: 2 cm is inside
    assert figures_of(visitors, TIMES, perfect(visitors, shift=0.03))["in_ellipsoid"] == 0.0
    assert (found["ids"], found["missing_s"], found["false_s"], found["false_people"]) == (1.0, 0.0, 0.0, 0)


def test_people_who_are_missing_are_counted(visitors):
    frames = perfect(visitors)
    for t in range(200, 350):
        frames[t] = replace(
            frames[t],
            ids=frames[t].ids[1:],
            positions=frames[t].positions[1:],
            covariances=frames[t].covariances[1:],
            ignored=None,
            views=None,
        )
    found = figures_of(visitors, TIMES, frames)
    assert found["missing_s"] == pytest.approx(1.5)
    assert found["output"] < 1.0


def test_people_who_stay_too_long_are_false(visitors):
    assert figures_of(visitors, TIMES, perfect(visitors, linger=0.9 * LINGER_S))["false_s"] == 0.0
    left = sum(person.present[1] < TIMES[-1] for person in visitors.people)
    found = figures_of(visitors, TIMES, perfect(visitors, linger=LINGER_S + 0.2))
    assert found["false_s"] == pytest.approx(0.2 * left, abs=0.02 * left) and found["false_people"] == 0


def test_a_false_person_and_a_second_id_are_counted(visitors):
    frames = []
    for t, frame in enumerate(perfect(visitors)):
        ids, extra = frame.ids.copy(), frame.positions[:1] + [0.0, 0.0, 5.0]
        if t >= 400:
            ids[ids == 0] = 50
        frames.append(SkeletonFrame(frame.stamp_ns, np.r_[ids, 99], np.r_[frame.positions, extra]))
    found = figures_of(visitors, TIMES, frames)
    assert found["false_people"] == 1 and found["false_s"] == pytest.approx(0.01 * len(TIMES))
    seen = sum(bool(present.any()) for present in visitors.present(TIMES))
    assert found["ids"] == pytest.approx((seen + 1) / len(visitors.people)) and found["mixed_ids"] == 0


def test_an_id_that_follows_two_people_is_counted(visitors):
    frames = []
    for frame in perfect(visitors):
        ids = frame.ids.copy()
        if 2 not in ids:
            ids[ids == 3] = 2
        frames.append(SkeletonFrame(frame.stamp_ns, ids, frame.positions))
    assert figures_of(visitors, TIMES, frames)["mixed_ids"] == 1


def test_continuous_is_better_than_aligned_frames_and_the_low_rate():
    take = simulate_free_running(replace(FREE_RUNNING_SCENES["faster"], seconds=4.0), 1)
    times = np.arange(1, 400) / 100.0
    task = CaptureUnderTest(take, times, ContinuousConfig())
    found = {name: METHODS[name](task) for name in METHODS}
    of_method = {
        name: figures_of(take, times, result.frames) for name, result in found.items() if name != "reference"
    }
    own = np.arange(280) / 70.0
    reference = figures_of(take, own, found["reference"].frames)
    assert reference["mean_m"] < 0.006 and of_method["continuous"]["mean_m"] < 1.5 * reference["mean_m"]
    for name in ("low rate", "aligned", "solve"):
        assert of_method[name]["mean_m"] > 2.0 * of_method["continuous"]["mean_m"]
        assert of_method[name]["output"] > 0.95
    errors = [of_method[f"lag {lag:g} s"]["mean_m"] for lag in LAGS]
    assert errors == sorted(errors, reverse=True) and errors[-2] < 1.6 * of_method["continuous"]["mean_m"]
    assert found["lag 0.1 s"].cpu_s > 0.0
    assert found["continuous"].wrong_views == 0.0 and of_method["continuous"]["ids"] == 1.0


def test_every_view_of_the_rendered_case_has_an_image_that_shows_its_person():
    take = simulate_free_running(replace(FREE_RUNNING_SCENES["rendered"], seconds=0.3), 1)
    frames = list(rendered_frames(take))
    assert sorted((f.camera, f.stamp_ns) for f in frames) == sorted(
        (one.view.camera, one.view.stamp_ns) for one in take.views
    )
    empty = list(
        rendered_frames(replace(take, people=tuple(replace(p, present=(9.0, 9.0)) for p in take.people)))
    )
    for frame, bare in zip(frames, empty):
        (one,) = (
            o for o in take.views if o.view.stamp_ns == frame.stamp_ns and o.view.camera == frame.camera
        )
        _, u = np.nonzero(np.abs(frame.image.astype(int) - bare.image).max(axis=2) > 60)
        pixels = take.rig.cameras[one.camera].project(take.joints(np.array([one.seconds]))[0, 0])[0]
        assert np.median(u) == pytest.approx(np.median(pixels[:, 0]), abs=15.0)


def test_groups_take_each_camera_once_and_the_nearest_view():
    take = simulate_free_running(replace(FREE_RUNNING_SCENES["free"], seconds=2.0), 1)
    task = CaptureUnderTest(take, np.array([1.0]))
    assert task.period_s == 1.0 / 25.0
    for group in task.groups():
        cameras = [one.camera for one in group]
        assert len(set(cameras)) == len(cameras)
        offsets = [1e-9 * (one.view.stamp_ns - task.stamp_of(group)) for one in group]
        assert np.abs(offsets).max() <= 0.5 * task.period_s + 1e-9


def test_the_study_shows_speeds_clocks_and_a_plot(tmp_path):
    result = run_named("continuous", "--cases clocks --seeds 1 --seconds 2")
    study = parsed("continuous", ["--cases", "clocks"])
    lines = list(study.lines(result))
    assert "they reproduce no sequence of the paper" in lines[0]
    assert any(line.startswith("clocks: ") and "RMS error of the offsets" in line for line in lines)
    assert [row["method"] for row in result["rows"]] == list(METHODS)
    assert result["rows"][0]["mean_ratio"] == 1.0
    study.plot(tmp_path / "plot.png", result)
    assert (tmp_path / "plot.png").read_bytes()[:4] == b"\x89PNG" and Continuous.has_plot
