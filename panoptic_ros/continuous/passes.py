"""Pass that turns the 2D people of a recording into motion as a function of time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from panoptic_ros.continuous.bones import rigid_pairs
from panoptic_ros.continuous.clocks import MARGIN_S, CameraTimes, FreeClocks, estimate_times
from panoptic_ros.continuous.config import ContinuousConfig
from panoptic_ros.continuous.follow import ViewTrack, camera_periods, follow
from panoptic_ros.continuous.motion_result import ContinuousMotion
from panoptic_ros.continuous.person import PersonCurve, fit_person
from panoptic_ros.continuous.problem import CurveProblem, TrackRays, grid_over
from panoptic_ros.continuous.returns import with_identities
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.solving.clock_gauge import acquainted, common_shift
from panoptic_ros.solving.frames import CameraFrame, camera_frames
from panoptic_ros.solving.spans import telling_spans
from panoptic_ros.stage import Progress, Recording, StageContext, part_of

Array = np.ndarray
CLOCK_ROUNDS = 2  # association and clocks in turn: wrong clocks cost some views of fast people
LEAST_VIEWS = 4  # minimum number of views of a person in a part that serves for clocks
UNKNOWN_PERIOD_S = 0.1  # s between frames where no camera has two
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

    def run(self, recording: Recording, progress: Progress) -> ContinuousMotion:
        """Return the motion of all people.

        Raises:
            DataError: if there is no view.
        """
        frames = self._frames(recording)
        if not frames:
            raise DataError("the recording has no view; give 2D people of at least two cameras")
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
        share = part_of(progress, begin, 1.0)
        for k, track in enumerate(tracks):
            share(k / len(tracks), "fitting curves")
            people.append(self._person(k, track, ordered, stamps[order], times, clocks))
        progress(1.0, "fitting curves")
        return ContinuousMotion(
            tuple(with_identities(people, self._skeleton, self._pairs)),
            reference,
            reference + round(1e9 * float(times[0])),
            reference + round(1e9 * float(times[-1])),
            float(np.median(camera_periods(frames, stamps) or [UNKNOWN_PERIOD_S])),
            self._rig.names,
            clocks,
            self._skeleton.hash,
        )

    def _frames(self, recording: Recording) -> list[CameraFrame]:
        """Return the views of a recording one by one, by timestamp; a view that repeats counts once."""
        frames = camera_frames(recording.records("detection_sets"), self._arrays, self._skeleton)
        unique = {(frame.stamp_ns, frame.camera): frame for frame in reversed(frames)}
        return [unique[key] for key in sorted(unique)]

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

    def _person(
        self,
        number: int,
        track: ViewTrack,
        frames: Sequence[CameraFrame],
        stamps: Array,
        times: Array,
        clocks: CameraTimes,
    ) -> PersonCurve:
        rays = TrackRays.of(track.entries, frames, stamps, self._arrays, self._mirror)
        seen = np.sort(times[[entry.frame for entry in track.entries]])
        return fit_person(number, rays, clocks.times(rays), seen, self._arrays, self._pairs)

    def _estimate(
        self, frames: Sequence[CameraFrame], stamps: Array, clocks: CameraTimes, progress: Progress
    ) -> CameraTimes:
        """Return the clocks and line delays."""
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
            clocks = estimate_times(problems, clocks, free, share)
        return self._referenced(clocks)

    def _referenced(self, clocks: CameraTimes) -> CameraTimes:
        """Return the clocks relative to most cameras if they agree; else their mean stays 0."""
        if self._trusted >= 0 or not self._config.clocks:
            return clocks
        count = len(self._rig)
        known = acquainted(clocks.covariance[:count, :count])
        values = clocks.values.copy()
        values[0] -= common_shift(values[0, known], clocks.deviations[0, known])
        values[1] -= values[1, known].mean()
        return CameraTimes(values, clocks.covariance)
