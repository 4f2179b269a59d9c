"""Clocks of a recorded capture, as in `panoptic solve`: solve, estimate, correct, and repeat."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from panoptic_ros.consensus.evidence import RigArrays
from panoptic_ros.domain import DetectionSet, Rig, SkeletonModel, TrackedPoseSet
from panoptic_ros.errors import UsageError
from panoptic_ros.offsets.association import associate
from panoptic_ros.offsets.clocks import CameraClocks
from panoptic_ros.offsets.estimate import fit_clocks
from panoptic_ros.offsets.frames import CameraFrame, camera_frames
from panoptic_ros.offsets.regroup import regroup
from panoptic_ros.offsets.tracks import Tracks

Array = np.ndarray
Solver = Callable[[Sequence[DetectionSet]], Sequence[TrackedPoseSet]]
SCALES = (0.15, 0.10)  # m, agreement of 2D people with tracks: wide while clocks are far off
WINDOWS, WINDOW_S = 12, 6.0  # of a long capture: number and length of the windows that are used
MOST_FRAMES = 12_000  # that the clocks are estimated from; if there are more, some of every camera
PRIOR_OFFSET = 0.1  # s
PRIOR_DRIFT = 5e-5


@dataclass(frozen=True, slots=True, eq=False)
class Corrected:
    """The clocks, and the sets that they give."""

    clocks: CameraClocks
    sets: list[DetectionSet]


def clocks_from_motion(
    frames: Sequence[CameraFrame], tracked: Sequence[TrackedPoseSet], start: CameraClocks, rig: Rig,
    skeleton: SkeletonModel, scale: float, trusted: str = "", arrays: RigArrays | None = None,
) -> CameraClocks:  # fmt: skip
    """One estimate.

    Args:
        frames: with the cameras' own stamps. tracked: people on the time line of `start`.
        start: clocks to begin with. scale: see `SCALES`. trusted: see `CameraClocks.of`.
    """
    count = len(rig)
    stamps = np.array([1e-9 * (frame.stamp_ns - start.reference_ns) for frame in frames])
    cameras = np.array([frame.camera for frame in frames], np.int64)
    times = stamps + start.offsets[cameras] + start.drifts[cameras] * stamps
    tracks = Tracks(tracked, start.reference_ns)
    seen = associate(frames, times, stamps, tracks, arrays or RigArrays.of(rig), skeleton, scale)
    prior = np.repeat([PRIOR_OFFSET, PRIOR_DRIFT], count)
    fit = fit_clocks(seen, count, start.offsets, start.drifts, prior)
    return CameraClocks.of(fit, rig.names, start.reference_ns, prior, trusted)


def correct_from_motion(
    sets: Sequence[DetectionSet], rig: Rig, skeleton: SkeletonModel, solve: Solver, trusted: str = ""
) -> Corrected:
    """Find the cameras' clocks from the people in a recorded capture, and group its frames by them.

    Pass 1 solves with the stamps as they are. If cameras are 60 ms apart, the rays of somebody who runs miss
    each other by 20 cm, so pass 1 loses some views of fast people. The estimate still uses every frame at its
    own stamp, and pass 2 repeats all with corrected stamps.

    Args:
        solve: tracked people of sets.
        trusted: a camera whose stamps are right; "": the offsets' mean is 0 unless most cameras agree.

    Raises:
        UsageError: if the rig lacks the trusted camera, or has one camera.
    """
    if trusted and trusted not in rig.names:
        raise UsageError(f"the trusted camera {trusted!r} is not in the rig; it has {', '.join(rig.names)}")
    if not sets:
        return Corrected(CameraClocks.unknown(rig.names, 0), [])
    arrays = RigArrays.of(rig)
    part = telling_part(sets)
    every = -(-sum(len(item.views) for item in part) // MOST_FRAMES)
    frames = camera_frames(part, arrays, skeleton, every)
    clocks = CameraClocks.unknown(rig.names, sets[len(sets) // 2].stamp_ns)
    current = part
    for scale in SCALES:
        clocks = clocks_from_motion(frames, solve(current), clocks, rig, skeleton, scale, trusted, arrays)
        current = regroup(part, clocks.corrections(part))
    return Corrected(clocks, regroup(sets, clocks.corrections(sets)))


def telling_part(sets: Sequence[DetectionSet]) -> list[DetectionSet]:
    """The sets that the clocks are estimated from: all of a short capture, some windows of a long one.

    A long capture is cut into equal parts. Each gives the window in which most 2D people are seen.
    """
    stamps = np.array([item.stamp_ns for item in sets], np.int64)
    if 1e-9 * (stamps[-1] - stamps[0]) <= WINDOWS * WINDOW_S:
        return list(sets)
    people = np.array([sum(len(view.points) for view in item.views) for item in sets])
    total = np.concatenate([[0], np.cumsum(people)])
    ends = np.searchsorted(stamps, stamps + round(1e9 * WINDOW_S))
    seen = total[ends] - total[np.arange(len(sets))]
    borders = np.linspace(stamps[0], stamps[-1], WINDOWS + 1)
    chosen: list[DetectionSet] = []
    first = 0
    for border in borders[1:]:
        last = int(np.searchsorted(stamps, border - 1e9 * WINDOW_S))
        if last > first:
            best = first + int(seen[first:last].argmax())
            chosen += sets[best : int(ends[best])]
        first = int(np.searchsorted(stamps, border))
    return chosen
