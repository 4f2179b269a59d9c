"""The offsets stage: clocks from motion while it goes on."""
from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np

from panoptic_ros.consensus.evidence import RigArrays
from panoptic_ros.domain import ClockModel, DetectionSet, TrackedPoseSet, ViewDetections
from panoptic_ros.errors import ConfigError, DataError
from panoptic_ros.offsets.association import associate
from panoptic_ros.offsets.clocks import CameraClocks
from panoptic_ros.offsets.config import OffsetsConfig
from panoptic_ros.offsets.estimate import fit_clocks
from panoptic_ros.offsets.filter import ClockFilter
from panoptic_ros.offsets.frames import CameraFrame, camera_frames
from panoptic_ros.offsets.passes import PRIOR_DRIFT, PRIOR_OFFSET, SCALES
from panoptic_ros.offsets.tracks import Tracks
from panoptic_ros.offsets.uncertainty import honest_information
from panoptic_ros.stage import Notice, StageContext, StepResult

Array = np.ndarray
SECOND = 1_000_000_000
FRAME_LIMIT = 4096  # frames that wait at most, e.g. while nobody is tracked
ALL_FRAMES = 10  # cameras up to which every frame is used; of more, as many frames in all, by turns


class OffsetsStage:
    """From views with the cameras' own stamps, and tracked people on the master time line, to clock models.

    A block is closed by the first tracked people that are `block_s` newer than its begin. Its frames are
    given to the tracks by the clocks that are in force, so what feeds back into sync comes from closed blocks
    alone, and a run in one process is deterministic. Cameras are corrected from when their offsets are more
    than chance.
    """

    def __init__(self, config: OffsetsConfig, context: StageContext):
        self._config, self._rig, self._skeleton = config, context.rig, context.skeleton
        self._arrays = RigArrays.of(context.rig)
        if config.trusted_camera and config.trusted_camera not in context.rig.names:
            raise ConfigError(
                f"offsets.trusted_camera = {config.trusted_camera!r} is no camera of the rig; it has "
                f"{', '.join(context.rig.names)}"
            )
        self.reset()

    def reset(self) -> None:
        """Forget all motion and clocks."""
        count = len(self._rig)
        self._prior = np.repeat([PRIOR_OFFSET, PRIOR_DRIFT], count)
        self._filter = ClockFilter(count, self._prior, self._config.memory_s)
        self._frames: deque[CameraFrame] = deque(maxlen=FRAME_LIMIT)
        self._turns: dict[str, int] = {}  # frames of every camera, counted from its place in the rig
        self._tracked: list[TrackedPoseSet] = []
        self._in_force: CameraClocks | None = None
        self._correcting = np.zeros(count, bool)
        self._told = False

    def step(self, item: ViewDetections | TrackedPoseSet) -> StepResult[ClockModel]:
        """Take a view or tracked people.

        Raises:
            DataError: on another skeleton, or a camera that the rig lacks.
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
        """Forget all; an unfinished block gives nothing, as nobody is left to use it."""
        self.reset()
        return StepResult()

    def _keep(self, view: ViewDetections) -> None:
        """Let a frame wait for the end of its block, if it is its camera's turn."""
        turn = self._turns.get(view.camera, self._arrays.index.get(view.camera, 0))
        if turn % -(-len(self._rig) // ALL_FRAMES) == 0:
            single = DetectionSet(0, view.stamp_ns, view.skeleton_hash, (replace(view, maps=None),))
            self._frames += camera_frames([single], self._arrays, self._skeleton)
        self._turns[view.camera] = turn + 1

    def _close(self) -> StepResult[ClockModel]:
        """Estimate from the block, and begin the next one with its last tracked people."""
        first, last = self._tracked[0].stamp_ns, self._tracked[-1].stamp_ns
        reference = (first + last) // 2
        frames = [frame for frame in self._frames if self._master(frame) <= last]
        rest = [frame for frame in self._frames if self._master(frame) > last]
        inside = [frame for frame in frames if self._master(frame) >= first]
        clocks, notices = self._estimate(inside, reference)
        self._frames = deque(rest, maxlen=FRAME_LIMIT)
        self._tracked = self._tracked[-1:]
        self._in_force = clocks
        newly = clocks.applied & clocks.known
        models = [model for model, new in zip(clocks.models(), newly) if new]
        return StepResult(tuple(models), notices)

    def _estimate(self, frames: list[CameraFrame], reference: int) -> tuple[CameraClocks, tuple[Notice, ...]]:
        count, before = len(self._rig), self._in_force
        if before is not None:
            self._filter.move(1e-9 * (reference - before.reference_ns))
        start, _ = self._filter.state()
        stamps = np.array([1e-9 * (frame.stamp_ns - reference) for frame in frames])
        times = np.array([1e-9 * (self._master(frame) - reference) for frame in frames])
        scale = SCALES[0] if before is None or not self._correcting.any() else SCALES[1]
        tracks = Tracks(self._tracked, reference)
        seen = associate(frames, times, stamps, tracks, self._arrays, self._skeleton, scale)
        fit = fit_clocks(seen, count, start[:count], start[count:], self._prior)
        jumps = np.zeros(count)
        if len(fit.seen.stamp):
            found = np.concatenate([fit.offsets, fit.drifts])
            jumps = self._filter.add(found, honest_information(fit, self._prior))
        state, covariance = self._filter.state()
        clocks = CameraClocks.stated(
            self._rig.names, reference, state, covariance, self._config.trusted_camera, fit,
            self._correcting,
        )  # fmt: skip
        if before is not None:
            clocks = clocks.after(before, self._config.trusted_camera)
        self._correcting = clocks.applied
        return clocks, (*_jump_notices(clocks, jumps), *self._notices(clocks))

    def _notices(self, clocks: CameraClocks) -> tuple[Notice, ...]:
        """Told once: which cameras' clocks are corrected."""
        if self._told or not clocks.applied.any():
            return ()
        self._told = True
        text = ", ".join(
            f"{name} {1e3 * offset:+.1f} ms"
            for name, offset, use in zip(clocks.cameras, clocks.offsets, clocks.applied) if use
        )  # fmt: skip
        return (Notice("offsets.corrected", "info", f"stamps are corrected from motion: {text}"),)

    def _master(self, frame: CameraFrame) -> int:
        """Time of a frame on the time line of the tracked people."""
        clocks, c = self._in_force, frame.camera
        if clocks is None or not self._correcting[c]:
            return frame.stamp_ns
        since = frame.stamp_ns - clocks.reference_ns
        return frame.stamp_ns + round(1e9 * clocks.offsets[c] + clocks.drifts[c] * since)


def _jump_notices(clocks: CameraClocks, jumps: Array) -> tuple[Notice, ...]:
    return tuple(
        Notice(
            "offsets.jump", "warning",
            f"the clock of camera {name} has jumped by about {-1e3 * jump:+.0f} ms against the others; what "
            "was known of it is forgotten, and found anew from motion",
            {"camera": name, "jump_s": -float(jump)},
        )
        for name, jump in zip(clocks.cameras, jumps) if jump
    )  # fmt: skip
