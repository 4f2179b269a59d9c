"""Clocks of a recorded capture, as in `panoptic solve`: solve, estimate, correct, and repeat."""

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
from panoptic_ros.offsets.frames import CameraFrame, camera_frames
from panoptic_ros.offsets.regroup import regroup
from panoptic_ros.offsets.tracks import Tracks
from panoptic_ros.stage import Progress, Recording, StageContext, each, part_of, untold

Array = np.ndarray
Solver = Callable[[Iterable[DetectionSet]], Sequence[TrackedPoseSet]]
Span = tuple[int, int]  # ns, up to but without the second
SCALES = (0.15, 0.10)  # m, agreement of 2D people with tracks: wide while clocks are far off
WINDOWS, WINDOW_S = 12, 6.0  # of a long capture: number and length of the windows that are used
SOLVED = 0.5  # share of the time that solving takes; the rest is the estimate
MOST_FRAMES = 12_000  # that the clocks are estimated from; if there are more, some of every camera
PRIOR_OFFSET = 0.1  # s
PRIOR_DRIFT = 5e-5


@dataclass(frozen=True, slots=True)
class MotionClocksConfig:
    """What `MotionClocks` needs to know.

    Args:
        solve: tracked people of sets, which it takes from first to last.
        trusted_camera: its stamps are right; "": the offsets' mean is 0 unless most cameras agree.
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
    """One estimate.

    Args:
        frames: with the cameras' own stamps. tracked: people on the time line of `start`.
        start: clocks to begin with. scale: see `SCALES`. trusted: see `CameraClocks.of`.
    """
    count = len(rig)
    stamps = np.array([1e-9 * (frame.stamp_ns - start.reference_ns) for frame in frames])
    cameras = np.array([frame.camera for frame in frames], np.int64)
    times = stamps + start.offsets[cameras] + start.drifts[cameras] * stamps
    progress(0.0, "associating 2D people with tracks")
    tracks = Tracks(tracked, start.reference_ns)
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
    """The cameras' clocks from the people in the detection sets of a recording: a `stage.Pass`.

    Pass 1 solves with the stamps as they are. If cameras are 60 ms apart, the rays of somebody who runs miss
    each other by 20 cm, so pass 1 loses some views of fast people. The estimate still uses every frame at its
    own stamp, and pass 2 repeats all with corrected stamps.

    Raises:
        UsageError: if the rig lacks the trusted camera.
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
        """The clocks; not known where there are no sets."""
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
        """Solve the sets of these clocks, and estimate better ones."""
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
    """Stamps (N,) ns of all sets, and how many 2D people each has (N,)."""
    found = [
        (item.stamp_ns, sum(len(view.points) for view in item.views))
        for item in recording.records("detection_sets")
    ]
    stamps, people = np.array(found, np.int64).reshape(-1, 2).T
    return stamps, people


def telling_spans(stamps: Array, people: Array) -> list[Span]:
    """Spans that the clocks are estimated from: all of a short capture, some windows of a long one.

    A long capture is cut into equal parts. Each gives the window in which most 2D people are seen.

    Args:
        stamps: (N,) ns, of the sets, one at least. people: (N,) number of 2D people of each.
    """
    first_ns, last_ns = int(stamps[0]), int(stamps[-1])
    if 1e-9 * (last_ns - first_ns) <= WINDOWS * WINDOW_S:
        return [(first_ns, last_ns + 1)]
    length = round(1e9 * WINDOW_S)
    total = np.concatenate([[0], np.cumsum(people)])
    seen = total[np.searchsorted(stamps, stamps + length)] - total[np.arange(len(stamps))]
    borders = np.linspace(stamps[0], stamps[-1], WINDOWS + 1)
    chosen: list[Span] = []
    first = 0
    for border in borders[1:]:
        last = int(np.searchsorted(stamps, border - 1e9 * WINDOW_S))
        if last > first:
            begin = int(stamps[first + int(seen[first:last].argmax())])
            chosen.append((begin, begin + length))
        first = int(np.searchsorted(stamps, border))
    return chosen
