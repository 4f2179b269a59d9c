"""Offsets stage: estimate camera clocks from motion, live."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from panoptic_ros.domain import (
    ClockModel,
    DetectionSet,
    Rig,
    SkeletonModel,
    TimeShift,
    TrackedPoseSet,
    ViewDetections,
    ViewSources,
)
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.errors import ConfigError, DataError
from panoptic_ros.offsets.association import associate
from panoptic_ros.offsets.clocks import CameraClocks
from panoptic_ros.offsets.config import OffsetsConfig
from panoptic_ros.offsets.estimate import ClockFilter, fit_clocks
from panoptic_ros.offsets.passes import PRIOR_DRIFT, PRIOR_OFFSET, SCALES
from panoptic_ros.offsets.tracks import TrackInterpolation
from panoptic_ros.offsets.uncertainty import honest_information
from panoptic_ros.params import named_numbers, of_name
from panoptic_ros.solving.example import cloud_of_joints, easy_instants
from panoptic_ros.solving.frames import CameraFrame, camera_frames
from panoptic_ros.stage import Notice, StageContext, StepResult
from panoptic_ros.state import Fields, Stateful, StateLayout

Array = np.ndarray
SECOND = 1_000_000_000
FRAME_LIMIT = 4096  # maximum number of buffered frames, for example while no person is tracked
# maximum number of cameras of which all frames are used. With more cameras, each gives a part of its frames,
# and the total stays the same.
ALL_FRAMES = 10
PATIENCE_S = 10.0  # s after which clocks that are still unknown are reported
STEP_NS = 33_000_000
FRAMES = 15  # number of frames to compile with: enough rays for a trajectory


class ClockNotices:
    """Notices on corrected cameras with their offsets, on clocks that have jumped, and on unknown clocks."""

    def __init__(self, cameras: Sequence[str]):
        self._cameras = tuple(cameras)
        self._told: set[str] = set()  # cameras whose correction has been reported
        self._passed = 0.0  # s, total time of all blocks
        self._missed = False  # True once the unknown clocks have been reported

    def of(self, clocks: CameraClocks, jumps: Array, seconds: float) -> tuple[Notice, ...]:
        """Return the notices of one block.

        Args:
            jumps: (C,) s, clock jumps in the block.
            seconds: (s) length of the block.
        """
        self._passed += seconds
        jumped = [_jump(name, float(jump)) for name, jump in zip(self._cameras, jumps) if jump]
        self._told -= {str(notice.values["camera"]) for notice in jumped}
        settled = clocks.applied & clocks.known & (jumps == 0.0)
        return (*jumped, *self._corrected(clocks, settled), *self._unknown(clocks))

    def _corrected(self, clocks: CameraClocks, settled: Array) -> tuple[Notice, ...]:
        new = [c for c in np.flatnonzero(settled) if self._cameras[c] not in self._told]
        if not new:
            return ()
        self._told |= {self._cameras[c] for c in new}
        text = ", ".join(
            f"{self._cameras[c]} {1e3 * clocks.offsets[c]:+.1f} ms +- {1e3 * clocks.deviations[c]:.1f}"
            for c in new
        )
        return (Notice("offsets.corrected", "info", f"stamps are corrected from motion: {text}"),)

    def _unknown(self, clocks: CameraClocks) -> tuple[Notice, ...]:
        if self._missed or self._passed < PATIENCE_S:
            return ()
        self._missed = True
        if clocks.known.all():
            return ()
        names = ", ".join(name for name, known in zip(self._cameras, clocks.known) if not known)
        text = (
            f"after {self._passed:.0f} s the clocks of {names} are unknown: there is too little motion "
            "in their views. Their stamps are kept; let a person walk about there"
        )
        return (Notice("offsets.unknown", "warning", text, {"cameras": names}),)


class OffsetsStage(Stateful):
    """Stage that converts views with camera timestamps, and tracked persons in master time, to clock models.

    A block ends at the first tracked set that is `block_s` newer than its beginning. Its frames are
    associated with the tracks by the current clocks. The feedback to sync thus comes from finished blocks
    alone, and a run in one process is deterministic. A camera is corrected as soon as its offset is
    significant.
    """

    LAYOUT = StateLayout(
        "offsets",
        ("_filter", "_frames", "_turns", "_tracked", "_in_force", "_correcting", "_notices"),
        (
            TrackedPoseSet,
            TimeShift,
            ViewSources,
            CameraClocks,
            CameraFrame,
            Fields.named(ClockFilter, "_cameras _prior _memory _information _vector"),
            Fields.named(ClockNotices, "_cameras _told _passed _missed"),
        ),
        shared=("_prior",),
        same={"configuration": "_config", "cameras": "_rig.names", "skeleton": "_skeleton.hash"},
    )

    def __init__(self, config: OffsetsConfig, context: StageContext):
        self._config, self._rig, self._skeleton = config, context.rig, context.skeleton
        self._arrays = RigArrays.of(context.rig)
        delays = named_numbers("OffsetsConfig.delays_ms", config.delays_ms)
        self._delays = {name: round(1e6 * of_name(delays, name)) for name in context.rig.names}
        if config.trusted_camera and config.trusted_camera not in context.rig.names:
            raise ConfigError(
                f"offsets.trusted_camera = {config.trusted_camera!r} is not a camera of the rig; it has "
                f"{', '.join(context.rig.names)}"
            )
        self.reset()
        if config.active:
            compile_kernels(context.rig, context.skeleton, self._arrays, self._prior)

    def reset(self) -> None:
        """Drop all motion and clocks."""
        count = len(self._rig)
        self._prior = np.repeat([PRIOR_OFFSET, PRIOR_DRIFT], count)
        self._filter = ClockFilter(count, self._prior, self._config.memory_s)
        self._frames: deque[CameraFrame] = deque(maxlen=FRAME_LIMIT)
        self._turns: dict[str, int] = {}  # per camera, number of its frames plus its index in the rig
        self._tracked: list[TrackedPoseSet] = []
        self._in_force: CameraClocks | None = None
        self._correcting = np.zeros(count, bool)
        self._notices = ClockNotices(self._rig.names)

    def step(self, item: ViewDetections | TrackedPoseSet) -> StepResult[ClockModel]:
        """Process a view or tracked persons; return clock models at the end of a block.

        Raises:
            DataError: the skeleton differs, or the rig has no such camera.
        """
        if not self._config.active:
            return StepResult()
        if isinstance(item, ViewDetections):
            self._keep(item)
            return StepResult()
        if item.skeleton_hash != self._skeleton.hash:
            raise DataError(
                f"tracked people of skeleton {item.skeleton_hash}, expected {self._skeleton.hash}"
            )
        self._tracked.append(item)
        if item.stamp_ns - self._tracked[0].stamp_ns < self._config.block_s * SECOND:
            return StepResult()
        return self._close()

    def flush(self) -> StepResult[ClockModel]:
        """Reset the stage. An unfinished block gives no clock models: no later frame could use them."""
        self.reset()
        return StepResult()

    def _keep(self, view: ViewDetections) -> None:
        """Buffer a frame until the block ends, if this frame of the camera is used (see `ALL_FRAMES`)."""
        turn = self._turns.get(view.camera, self._arrays.index.get(view.camera, 0))
        if turn % -(-len(self._rig) // ALL_FRAMES) == 0:
            stamp = max(0, view.stamp_ns + self._delays.get(view.camera, 0))
            bare = replace(view, maps=None, stamp_ns=stamp)
            single = DetectionSet(0, stamp, view.skeleton_hash, (bare,))
            self._frames += camera_frames([single], self._arrays, self._skeleton)
        self._turns[view.camera] = turn + 1

    def _close(self) -> StepResult[ClockModel]:
        """Estimate the clocks from the block, and begin the next block with its last tracked set."""
        first, last = self._tracked[0].stamp_ns, self._tracked[-1].stamp_ns
        reference = (first + last) // 2
        frames = [frame for frame in self._frames if self._master(frame) <= last]
        rest = [frame for frame in self._frames if self._master(frame) > last]
        inside = [frame for frame in frames if self._master(frame) >= first]
        clocks, jumps = self._estimate(inside, reference)
        self._frames = deque(rest, maxlen=FRAME_LIMIT)
        self._tracked = self._tracked[-1:]
        self._in_force = clocks
        newly = clocks.applied & clocks.known
        models = [model for model, new in zip(clocks.models(), newly) if new]
        return StepResult(tuple(models), self._notices.of(clocks, jumps, 1e-9 * (last - first)))

    def _estimate(self, frames: list[CameraFrame], reference: int) -> tuple[CameraClocks, Array]:
        """Return the clocks, and the jump (C,) s of each of them."""
        count, before = len(self._rig), self._in_force
        if before is not None:
            self._filter.move(1e-9 * (reference - before.reference_ns))
        start, _ = self._filter.state()
        stamps = np.array([1e-9 * (frame.stamp_ns - reference) for frame in frames])
        times = np.array([1e-9 * (self._master(frame) - reference) for frame in frames])
        scale = SCALES[0] if before is None or not self._correcting.any() else SCALES[1]
        tracks = TrackInterpolation(self._tracked, reference)
        seen = associate(frames, times, stamps, tracks, self._arrays, self._skeleton, scale)
        fit = fit_clocks(seen, count, start[:count], start[count:], self._prior)
        jumps = np.zeros(count)
        if len(fit.seen.stamp):
            found = np.concatenate([fit.offsets, fit.drifts])
            jumps = self._filter.add(found, honest_information(fit, self._prior))
        state, covariance = self._filter.state()
        clocks = CameraClocks.stated(
            self._rig.names,
            reference,
            state,
            covariance,
            self._config.trusted_camera,
            fit,
            self._correcting,
        )
        if before is not None:
            clocks = clocks.after(before, self._config.trusted_camera)
        self._correcting = clocks.applied
        return clocks, jumps

    def _master(self, frame: CameraFrame) -> int:
        """Return the time of a frame on the time line of the tracked persons, ns."""
        clocks, c = self._in_force, frame.camera
        if clocks is None or not self._correcting[c]:
            return frame.stamp_ns
        since = frame.stamp_ns - clocks.reference_ns
        master_ns: int = frame.stamp_ns + round(1e9 * clocks.offsets[c] + clocks.drifts[c] * since)
        return master_ns


def _jump(name: str, jump: float) -> Notice:
    text = (
        f"the clock of camera {name} has jumped by about {-1e3 * jump:+.0f} ms against the others; "
        "it is estimated again from motion"
    )
    return Notice("offsets.jump", "warning", text, {"camera": name, "jump_s": -jump})


def compile_kernels(rig: Rig, skeleton: SkeletonModel, arrays: RigArrays, prior: np.ndarray) -> None:
    """Compile all kernels by a fit to a person at rest, or load them from the cache.

    Args:
        prior: (2C,) standard deviations of the clocks, see `fit_clocks`.
    """
    first = next(iter(easy_instants(rig, skeleton)))
    sets = [
        replace(first, views=tuple(replace(view, stamp_ns=k * STEP_NS) for view in first.views))
        for k in range(FRAMES)
    ]
    frames = camera_frames(sets, arrays, skeleton)
    stamps = np.array([1e-9 * frame.stamp_ns for frame in frames])
    tracked = [_tracked(k, cloud_of_joints(rig, skeleton), skeleton) for k in range(FRAMES)]
    seen = associate(frames, stamps, stamps, TrackInterpolation(tracked, 0), arrays, skeleton, 0.1)
    fit_clocks(seen, len(rig), np.zeros(len(rig)), np.zeros(len(rig)), prior)


def _tracked(index: int, joints: np.ndarray, skeleton: SkeletonModel) -> TrackedPoseSet:
    ones = np.ones((1, len(joints)))
    spread = np.tile(1e-4 * np.eye(3), (1, len(joints), 1, 1))
    return TrackedPoseSet(
        index,
        index * STEP_NS,
        skeleton.hash,
        joints[None],
        spread,
        ones,
        2 * ones,
        ones,
        np.ones(1),
        ids=np.array([0]),
    )
