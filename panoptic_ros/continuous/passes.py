"""Pass that turns the 2D people of a recording into motion as a function of time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from panoptic_ros.continuous.bones import rigid_pairs
from panoptic_ros.continuous.bystanders import first_inside, has_human_size
from panoptic_ros.continuous.clocks import DRIFT_ROUND, MARGIN_S, CameraTimes, FreeClocks, estimate_times
from panoptic_ros.continuous.config import ContinuousConfig
from panoptic_ros.continuous.faults import (
    ClockFault,
    clock_faults,
    fault_notices,
    misfit_notices,
    views_without,
)
from panoptic_ros.continuous.follow import camera_periods, follow
from panoptic_ros.continuous.motion_result import ContinuousMotion
from panoptic_ros.continuous.person import PersonCurve, fit_person
from panoptic_ros.continuous.problem import CurveProblem, TrackRays, grid_over
from panoptic_ros.continuous.returns import TOGETHER, with_identities
from panoptic_ros.continuous.seen_views import SeenViews
from panoptic_ros.continuous.stamps import partial_notices, usable_views
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.solving.calibration_errors import CalibrationErrors
from panoptic_ros.solving.capture_space import needed_views
from panoptic_ros.solving.frames import CameraFrame, camera_frames
from panoptic_ros.solving.spans import telling_spans
from panoptic_ros.stage import Progress, Recording, StageContext, part_of

Array = np.ndarray
CLOCK_ROUNDS = 2  # association and clocks in turn: wrong clocks cost some views of fast people
LEAST_VIEWS = 4  # minimum number of views of a person in a part that is used for clocks
UNKNOWN_PERIOD_S = 0.1  # s between frames where no camera has two
FAULT_ROUNDS = 2  # number of repetitions without views whose timestamps contradict the others
CLOCKS_SHARE = 0.5  # share of the run time for clocks


class ContinuousPass:
    """Pass (`stage.Pass`): association view by view, clocks if asked for, and a curve per joint.

    Raises:
        UsageError: the rig lacks the trusted camera, or has one camera only.
    """

    def __init__(self, config: ContinuousConfig, context: StageContext):
        rig, trusted = context.rig, config.trusted_camera
        if len(rig) < 2:
            raise UsageError(f"{len(rig)} camera is not enough for 3D; give two or more")
        if trusted and trusted not in rig.names:
            raise UsageError(
                f"the trusted camera {trusted!r} is not in the rig; it has {', '.join(rig.names)}"
            )
        self._config, self._rig, self._skeleton = config, rig, context.skeleton
        self._arrays = RigArrays.of(rig)
        self._pairs = rigid_pairs(context.skeleton)
        self._mirror = np.array(context.skeleton.mirror)
        self._trusted = rig.names.index(trusted) if trusted else -1
        self._needed_views = needed_views(config.capture_views, rig.cameras)

    def run(self, recording: Recording, progress: Progress) -> ContinuousMotion:
        """Return the motion of all people.

        Raises:
            DataError: if fewer than two cameras have views.
        """
        names = self._rig.names
        seen = camera_frames(recording.records("detection_sets"), self._arrays, self._skeleton)
        frames, notices = usable_views(seen, names)
        _check_cameras(frames, names)
        motion, faults, kept = self._motion(frames, progress)
        told = {name for notice in notices for name in notice.values["views"]}
        faulty = {names.index(name) for name in told}
        for _ in range(FAULT_ROUNDS):
            if not faults:
                break
            notices += fault_notices(faults, names)
            faulty |= {fault.camera for fault in faults}
            frames = kept
            motion, faults, kept = self._motion(
                frames, lambda share, doing: progress(1.0, f"{doing} without faulty views")
            )
        notices += partial_notices(frames, names, faulty)
        return replace(motion, notices=(*notices, *motion.notices))

    def _motion(
        self, frames: Sequence[CameraFrame], progress: Progress
    ) -> tuple[ContinuousMotion, list[ClockFault], list[CameraFrame]]:
        """Return the motion of all people, cameras whose timestamps contradict it, and the other views."""
        reference = (frames[0].stamp_ns + frames[-1].stamp_ns) // 2
        stamps = np.array([1e-9 * (frame.stamp_ns - reference) for frame in frames])
        lines = np.array([1e-6 * camera.line_delay_us for camera in self._rig.cameras])
        zero = np.zeros(len(self._rig))
        clocks = CameraTimes.given(zero, zero, lines)
        asked = self._config.clocks or self._config.rolling_shutter
        begin = CLOCKS_SHARE if asked else 0.0
        if asked:
            clocks = self._estimate(frames, stamps, clocks, part_of(progress, 0.0, begin))
        order, times = self._ordered(frames, stamps, clocks)
        ordered = [frames[k] for k in order]
        progress(begin, "associating views")
        tracks = follow(ordered, times, self._arrays, self._mirror)
        people = []
        period = float(np.median(camera_periods(frames, stamps) or [UNKNOWN_PERIOD_S]))
        share = part_of(progress, begin, 1.0)
        for k, track in enumerate(tracks):
            share(k / len(tracks), "fitting curves")
            seen = SeenViews.of(track.entries, ordered, stamps[order], self._mirror)
            corrected = seen._replace(times=times[seen.frames])
            person = self._person(k, seen, corrected.times, clocks)
            came = first_inside(corrected, person.at, period, self._rig.cameras, self._needed_views)
            if came is not None and has_human_size(person.bones.lengths):
                people.append((person, came))
        progress(1.0, "fitting curves")
        motion = ContinuousMotion(
            tuple(with_identities(people, self._skeleton, self._pairs, times, TOGETHER * period)),
            reference,
            reference + round(1e9 * float(times[0])),
            reference + round(1e9 * float(times[-1])),
            period,
            self._rig.names,
            clocks,
            self._skeleton.hash,
            len(self._skeleton),
            self._skeleton.derived,
            tuple(misfit_notices(ordered, times, tracks, self._rig.names)),
            CalibrationErrors.of(self._rig.cameras),
            self._skeleton.bias_floors,
        )
        faults = clock_faults(ordered, times, [person for person, _ in people], self._arrays)
        return motion, faults, views_without(faults, ordered, times)

    def _ordered(
        self, frames: Sequence[CameraFrame], stamps: Array, clocks: CameraTimes
    ) -> tuple[Array, Array]:
        """Return the order (F,) of the frames by corrected time, and these times (F,) s in that order."""
        cameras = np.array([frame.camera for frame in frames])
        middle = np.array([0.5 * camera.image_size[1] for camera in self._rig.cameras])[cameras]
        offsets, drifts, lines = clocks.values[:, cameras]
        times = stamps + offsets + drifts * stamps + lines * middle
        order = np.argsort(times, kind="stable")
        return order, times[order]

    def _person(self, number: int, seen: SeenViews, times: Array, clocks: CameraTimes) -> PersonCurve:
        """Return the curves of a person, given the views with uncorrected and corrected times (V,) s."""
        rays = TrackRays.of_views(seen, self._arrays)
        person = fit_person(number, rays, clocks.times(rays), times, self._arrays, self._pairs)
        return person.with_derived(self._skeleton.derived)

    def _estimate(
        self, frames: Sequence[CameraFrame], stamps: Array, clocks: CameraTimes, progress: Progress
    ) -> CameraTimes:
        """Return the clocks and line delays; those that are not observable stay as given."""
        given = clocks
        free = FreeClocks(self._config.clocks, self._config.rolling_shutter, self._trusted)
        reference = frames[0].stamp_ns
        spans = telling_spans(
            np.array([frame.stamp_ns for frame in frames]), np.array([len(frame.plane) for frame in frames])
        )
        limits = [(1e-9 * (a - reference) + stamps[0], 1e-9 * (b - reference) + stamps[0]) for a, b in spans]
        for k in range(CLOCK_ROUNDS):
            share = part_of(progress, k / CLOCK_ROUNDS, (k + 1) / CLOCK_ROUNDS)
            share(0.0, "associating views")
            problems: list[CurveProblem] = []
            order, times = self._ordered(frames, stamps, clocks)
            for first, last in limits:
                inside = (times >= first) & (times <= last)
                part = [frames[i] for i in order[inside]]
                for track in follow(part, times[inside], self._arrays, self._mirror):
                    if len(track.entries) >= LEAST_VIEWS:
                        rays = TrackRays.of(
                            track.entries, part, stamps[order[inside]], self._arrays, self._mirror
                        )
                        corrected = clocks.times(rays)
                        grid = grid_over(corrected, MARGIN_S)
                        problems.append(CurveProblem(rays, corrected, self._arrays, grid))
            clocks = estimate_times(problems, clocks, given, free, share, DRIFT_ROUND if k else 0)
        if self._config.clocks and self._trusted < 0:
            clocks = clocks.referenced()
        return clocks.applicable(given)


def _check_cameras(frames: Sequence[CameraFrame], names: Sequence[str]) -> None:
    """Check that two cameras have views.

    Raises:
        DataError: if they have not.
    """
    if not frames:
        raise DataError("the recording has no view; give 2D people of at least two cameras")
    cameras = {frame.camera for frame in frames}
    if len(cameras) == 1:
        (only,) = cameras
        raise DataError(
            f"all {len(frames)} views are of camera {names[only]}, which is not enough for 3D; give views of "
            "two or more cameras"
        )
