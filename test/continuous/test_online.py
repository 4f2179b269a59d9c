"""Motion while the views arrive."""

import captures
import numpy as np
import pytest
from free_cameras import FreeCapture

from panoptic_ros.continuous.config import ContinuousStageConfig
from panoptic_ros.continuous.curves import KnotGrid, covariances_at
from panoptic_ros.continuous.online import BEFORE_S, OnlineMotion
from panoptic_ros.continuous.periods import CameraPeriods
from panoptic_ros.continuous.problem import STEP_S, CurveProblem, TrackRays
from panoptic_ros.domain.of_all import selected
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.geometry.splines import control_points, spline
from panoptic_ros.solving.frames import camera_frames

CAPTURE = FreeCapture(seconds=2.5)
ARRAYS = RigArrays.of(CAPTURE.rig)
FRAMES = camera_frames(CAPTURE.sets, ARRAYS, captures.SKELETON)
STAMPS = np.array([1e-9 * (frame.stamp_ns - 1_000_000_000_000) for frame in FRAMES])


def play(lag, frames=FRAMES, stamps=STAMPS):
    motion = OnlineMotion(ARRAYS, captures.SKELETON, ContinuousStageConfig())
    instants, found, k = np.arange(0.5, stamps[-1] - lag, 0.05), [], 0
    for frame, time in zip(frames, stamps):
        while k < len(instants) and instants[k] + lag < time:
            found.append((instants[k], motion.at(instants[k])))
            k += 1
        motion.take(frame, time)
        motion.settle()
    return motion, found


@pytest.mark.parametrize(("lag", "limit"), [(0.0, 0.02), (0.1, 0.005)])
def test_each_instant_comes_from_the_views_up_to_the_lag(lag, limit):
    _, found = play(lag)
    gaps = []
    for time, people in found:
        truth = CAPTURE.joints(time)
        assert [person.id for person in people] == [0, 1]
        for person in people:
            gaps.append(np.linalg.norm(truth - person.report.positions, axis=-1).mean(axis=1).min())
    assert np.mean(gaps) < limit


def test_velocities_are_those_of_the_people():
    _, found = play(0.1)
    time, people = found[-3]
    truth = (CAPTURE.joints(time + 1e-3) - CAPTURE.joints(time - 1e-3)) / 2e-3
    for person in people:
        assert np.linalg.norm(truth - person.velocities, axis=-1).mean(axis=1).min() < 0.15


def test_an_instant_is_a_point_of_the_curve_of_its_window():
    """The same as `CurveProblem`, which computes whole curves; lengths move it by little."""
    motion, _ = play(0.1)
    time = float(STAMPS[-1]) - 0.1
    for person in motion._people.values():
        seen = selected(person.seen, person.seen.times >= time - BEFORE_S)
        rays = TrackRays.of_views(seen, ARRAYS)
        first, last = float(rays.stamps.min()), float(rays.stamps.max()) + STEP_S
        grid = KnotGrid(first, STEP_S, control_points(first, last, STEP_S))
        problem = CurveProblem(rays, rays.stamps, ARRAYS, grid, person.noise)
        problem.compare(problem.fit())
        exact = problem.fit()
        with_lengths = motion._fit(person, person.noise, time)
        person.bones = None
        fit = motion._fit(person, person.noise, time)
        curve = spline(grid.origin, grid.step, exact.points.transpose(1, 0, 2))
        np.testing.assert_allclose(fit.positions, curve(time), atol=1e-9)
        np.testing.assert_allclose(fit.velocities, curve(time, 1), atol=1e-7)
        covariances = covariances_at(exact.inverses, grid, np.array([time]))[:, 0]
        np.testing.assert_allclose(fit.covariances, covariances, rtol=1e-9, atol=1e-15)
        assert 1e-5 < np.abs(with_lengths.positions - fit.positions).max() < 5e-3


def test_memory_is_bounded():
    motion, _ = play(0.1)
    assert len(motion._frames) <= 1.7 * 60
    for person in motion._people.values():
        assert len(person.track.entries) <= 1.7 * 60 and len(person.seen.times) <= 1.7 * 60
        assert person.distances.lengths.shape[1] <= 500


def test_instants_change_nothing():
    """More instants, at other times, in any order: the later motion is the same."""
    plain, _ = play(0.1)
    asked = OnlineMotion(ARRAYS, captures.SKELETON, ContinuousStageConfig())
    for frame, time in zip(FRAMES, STAMPS):
        asked.take(frame, time)
        asked.settle()
        asked.at(time - 0.3)
        asked.at(time + 0.02)
    one, other = (motion.at(2.35) for motion in (plain, asked))
    for a, b in zip(one, other, strict=True):
        assert np.array_equal(a.report.positions, b.report.positions)


def test_a_person_who_was_away_for_a_moment_keeps_the_id():
    capture = FreeCapture(seconds=3.6, there=lambda person, time: person == 0 or not 1.2 < time < 2.2)
    frames = camera_frames(capture.sets, ARRAYS, captures.SKELETON)
    stamps = np.array([1e-9 * (frame.stamp_ns - 1_000_000_000_000) for frame in frames])
    _, found = play(0.1, frames, stamps)
    ids = {round(time, 2): [person.id for person in people] for time, people in found}
    assert ids[1.0] == [0, 1] and len(ids[2.0]) == 1 and ids[3.0] == [0, 1]


def test_people_who_wait_for_longer_than_views_are_kept_get_numbers():
    motion, _ = play(0.1)
    for person in motion._people.values():
        person.id, person.appeared = -1, float(STAMPS[0]) - 3.0
    motion._number_people(float(STAMPS[-1]))
    assert sorted(person.id for person in motion._people.values()) == [2, 3]


def test_people_are_reported_for_half_a_second_without_views():
    motion, _ = play(0.1)
    last = float(STAMPS[-1])
    assert len(motion.at(last + 0.4)) == 2 and motion.at(last + 0.51) == []


def test_the_periods_of_cameras_come_from_their_newest_frames():
    periods = CameraPeriods()
    assert periods.pairing_time == 0.08
    for k in range(20):
        periods.take(0, 0.02 * k)
        periods.take(1, 0.3 * k)
    periods.take(0, 9.0)  # a pause
    assert periods.pairing_time == pytest.approx(0.15) and periods.typical == pytest.approx(0.3)
