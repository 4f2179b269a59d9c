"""Estimate the clocks of a recorded capture, as in `panoptic solve`: solve, estimate, correct, and repeat."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain import DetectionSet, Rig, SkeletonModel, TrackedPoseSet
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.errors import UsageError
from panoptic_ros.offsets.association import associate
from panoptic_ros.offsets.clocks import CameraClocks
from panoptic_ros.offsets.estimate import fit_clocks
from panoptic_ros.offsets.regroup import regroup
from panoptic_ros.offsets.tracks import TrackInterpolation
from panoptic_ros.solving.frames import CameraFrame, camera_frames
from panoptic_ros.solving.spans import telling_spans
from panoptic_ros.stage import Progress, Recording, StageContext, each, part_of, untold

Array = np.ndarray
Solver = Callable[[Iterable[DetectionSet]], Sequence[TrackedPoseSet]]
# m, agreement scale of 2D poses with tracks, per pass: larger while the clock errors are large
SCALES = (0.15, 0.10)
SOLVED = 0.5  # share of the run time for solving; the remainder is the estimate
# maximum number of frames for the estimate; if there are more, each camera is subsampled
MOST_FRAMES = 12_000
PRIOR_OFFSET = 0.1  # s, standard deviation
PRIOR_DRIFT = 5e-5


@dataclass(frozen=True, slots=True)
class MotionClocksConfig:
    """Configuration of `MotionClocks`.

    Args:
        solve: solver that returns tracked persons for sets, which it reads in order.
        trusted_camera: camera with right timestamps; "" = most cameras, if they agree, else mean offset 0.
    """

    solve: Solver
    trusted_camera: str = ""


def clocks_from_motion(
    frames: Sequence[CameraFrame],
    tracked: Sequence[TrackedPoseSet],
    start: CameraClocks,
    rig: Rig,
    skeleton: SkeletonModel,
    scale: float,
    trusted: str = "",
    arrays: RigArrays | None = None,
    progress: Progress = untold,
) -> CameraClocks:
    """Estimate the camera clocks in one pass, from the 2D poses of frames and 3D tracks.

    Args:
        frames: 2D poses of images, with the timestamps of the cameras' own clocks.
        tracked: 3D tracks, solved from detections whose timestamps are corrected by the clocks `start`.
        start: clocks before this pass.
        scale: (m) distance scale of the agreement between 2D poses and tracks, see `SCALES`.
        trusted: camera whose timestamps are right; "": see `CameraClocks.of`.
        arrays: the rig as arrays; None: they are made from `rig`.
    """
    count = len(rig)
    stamps = np.array([1e-9 * (frame.stamp_ns - start.reference_ns) for frame in frames])
    cameras = np.array([frame.camera for frame in frames], np.int64)
    times = stamps + start.offsets[cameras] + start.drifts[cameras] * stamps
    progress(0.0, "associating 2D people with tracks")
    tracks = TrackInterpolation(tracked, start.reference_ns)
    seen = associate(frames, times, stamps, tracks, arrays or RigArrays.of(rig), skeleton, scale)
    prior = np.repeat([PRIOR_OFFSET, PRIOR_DRIFT], count)
    fit = fit_clocks(
        seen,
        count,
        start.offsets,
        start.drifts,
        prior,
        progress=lambda share: progress(0.2 + 0.8 * share, "estimating clocks"),
    )
    progress(1.0, "estimating clocks")
    return CameraClocks.of(fit, rig.names, start.reference_ns, prior, trusted)


class MotionClocks:
    """Pass (`stage.Pass`) that estimates camera clocks from the 2D poses of a recording.

    Pass 1 solves with the original timestamps. If cameras are 60 ms apart, the rays of a running person miss
    each other by 20 cm. Pass 1 therefore loses some views of fast persons. The estimate still uses every
    frame at its own timestamp, and pass 2 repeats everything with corrected timestamps.

    Raises:
        UsageError: the rig lacks the trusted camera.
    """

    def __init__(self, config: MotionClocksConfig, context: StageContext):
        rig, trusted = context.rig, config.trusted_camera
        if trusted and trusted not in rig.names:
            raise UsageError(
                f"the trusted camera {trusted!r} is not in the rig; it has {', '.join(rig.names)}"
            )
        self._config, self._rig, self._skeleton = config, rig, context.skeleton
        self._arrays = RigArrays.of(rig)

    def run(self, recording: Recording, progress: Progress) -> CameraClocks:
        """Return the clocks; they are unknown if there are no sets."""
        stamps, people = _people_seen(recording)
        if not len(stamps):
            progress(1.0, "no sets")
            return CameraClocks.unknown(self._rig.names, 0)
        part = [
            item
            for begin, end in telling_spans(stamps, people)
            for item in recording.records("detection_sets", begin_ns=begin, end_ns=end)
        ]
        every = -(-sum(len(item.views) for item in part) // MOST_FRAMES)
        frames = camera_frames(part, self._arrays, self._skeleton, every)
        clocks = CameraClocks.unknown(self._rig.names, int(stamps[len(stamps) // 2]))
        current: Sequence[DetectionSet] = part
        for k, scale in enumerate(SCALES):
            share = part_of(progress, k / len(SCALES), (k + 1) / len(SCALES))
            clocks = self._estimate(frames, current, clocks, scale, share)
            current = regroup(part, clocks.corrections(part))
        return clocks

    def _estimate(
        self,
        frames: Sequence[CameraFrame],
        sets: Sequence[DetectionSet],
        start: CameraClocks,
        scale: float,
        progress: Progress,
    ) -> CameraClocks:
        """Solve the sets grouped by the clocks `start`, and return improved clocks."""
        told = each(sets, len(sets), part_of(progress, 0.0, SOLVED), "solving")
        return clocks_from_motion(
            frames,
            self._config.solve(told),
            start,
            self._rig,
            self._skeleton,
            scale,
            self._config.trusted_camera,
            self._arrays,
            part_of(progress, SOLVED, 1.0),
        )


def _people_seen(recording: Recording) -> tuple[Array, Array]:
    """Return the timestamps (N,) ns of all sets, and the number (N,) of 2D poses in each."""
    found = [
        (item.stamp_ns, sum(len(view.points) for view in item.views))
        for item in recording.records("detection_sets")
    ]
    stamps, people = np.array(found, np.int64).reshape(-1, 2).T
    return stamps, people
