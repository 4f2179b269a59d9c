"""Patches stage: from 2D tracks and tracked skeletons to part motions and surface patches."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

import numpy as np

from panoptic_ros.domain import (
    DepthFrame,
    JointState,
    PartMotions,
    PatchTracks,
    PatchTrajectories,
    TrackedPoseSet,
    ViewSources,
)
from panoptic_ros.domain.parts import rigid_parts
from panoptic_ros.errors import DataError
from panoptic_ros.patches.carried import PropagatedJoints
from panoptic_ros.patches.config import PatchesConfig
from panoptic_ros.patches.depth_buffer import ready
from panoptic_ros.patches.depth_maps import DepthMaps, free_joints
from panoptic_ros.patches.lifting import Capsules, axes, joined
from panoptic_ros.patches.motions import LiftedTracks, PartTracker, expectation, no_motions
from panoptic_ros.patches.surface import Surface, moved, no_surface, seeded
from panoptic_ros.stage import Notice, StageContext, StepResult
from panoptic_ros.state import Stateful, StateLayout

Array = np.ndarray
KEPT = 16  # number of newest tracks of a camera that wait for their instant
LONGEST_NS = 500_000_000  # greatest time between two instants for which motions are computed
NOTHING_FREE = np.zeros((0, 2), np.int64)
SILENT = 25  # instants with people but without tracks, or without a motion, after which a notice is given
NO_TRACKS = (
    Notice(
        "patches.no_tracks",
        "warning",
        "no camera has 2D tracks: motion is not measured; do images arrive, and is flow running?",
    ),
    Notice("patches.tracks_back", "info", "2D tracks arrive again"),
)
NO_MOTION = (
    Notice(
        "patches.no_motion",
        "warning",
        "2D tracks agree on the motion of no part: it is not measured; are images blurred or frozen?",
    ),
    Notice("patches.motion_back", "info", "the motion of parts is measured again"),
)


class PatchesStage(Stateful):
    """Stage for part motions and surface patches of people, for each set of skeletons.

    Maps of depth sensors, if any, state the position of the surface, its occluders, and joints in free space.
    Skeletons must name their 2D poses (`TrackedPoseSet.sources`), which connect them with 2D tracks.
    """

    LAYOUT = StateLayout(
        "patches",
        "_tracks _people _before _last _surface _next _silent _blind _free _depth.maps _depth.shares "
        "_depth.believed _depth.meets _depth.told".split(),
        (PatchTracks, TrackedPoseSet, ViewSources, PropagatedJoints, PartMotions, Surface, DepthFrame),
        same={"configuration": "_config", "cameras": "_names", "skeleton": "_hash", "sensors": "_sensors"},
    )

    def __init__(self, config: PatchesConfig, context: StageContext):
        self._config, self._skeleton, self._hash = config, context.skeleton, context.skeleton.hash
        self._names = context.rig.names
        self._parts = rigid_parts(context.skeleton)
        self._tracker = PartTracker(config, context.rig, context.skeleton, self._parts)
        self._depth = DepthMaps(context.rig)
        ready()
        self._sensors = tuple(self._depth.cameras)
        self._most = np.array([config.per_part * (1 + (part.name == "torso")) for part in self._parts])
        self.reset()
        for example in _examples(context):
            self.step(example)
        self.reset()

    def reset(self) -> None:
        """Forget all people."""
        self._tracks: dict[str, deque[PatchTracks]] = {}
        self._people: dict[int, PropagatedJoints] = {}
        self._before: TrackedPoseSet | None = None
        self._last = no_motions()
        self._surface = no_surface(len(self._names))
        self._next = 0
        self._silent, self._blind, self._free = 0, 0, NOTHING_FREE
        self._depth.forget()

    def flush(self) -> StepResult[PatchTrajectories]:
        """Reset the stage; it buffers no records."""
        self.reset()
        return StepResult()

    def step(self, item: PatchTracks | DepthFrame | TrackedPoseSet) -> StepResult[PatchTrajectories]:
        """Return the patches of a set of skeletons, or accept the 2D tracks and depth maps that precede it.

        Raises:
            DataError: if the record has another skeleton, a camera or depth sensor that the rig lacks, or
                another size than its sensor.
        """
        if isinstance(item, DepthFrame):
            self._depth.take(item)
            return StepResult()
        if item.skeleton_hash != self._hash:
            what = "2D tracks" if isinstance(item, PatchTracks) else "skeletons"
            raise DataError(f"{what} of skeleton {item.skeleton_hash}, but patches work on {self._hash}")
        if isinstance(item, PatchTracks):
            if item.camera not in self._names:
                raise DataError(f"2D tracks of camera {item.camera}, which is not in the rig")
            self._tracks.setdefault(item.camera, deque(maxlen=KEPT)).append(item)
            return StepResult()
        before = self._before
        if before is not None and item.stamp_ns <= before.stamp_ns:
            text = f"a set of stamp {item.stamp_ns} came after one of {before.stamp_ns}; it was dropped"
            return StepResult(notices=(Notice("patches.old_stamp", "warning", text),))
        tracks = {} if item.sources is None else item.sources.taken_from(self._tracks)
        notices: tuple[Notice, ...] = ()
        free = NOTHING_FREE
        if before is None or item.stamp_ns - before.stamp_ns > LONGEST_NS:
            self._begin_anew(item)
        else:
            notices = self._depth.judge(item.stamp_ns, joined(list(self._capsules().values())))
            free = free_joints(self._depth, self._parts, before, item, self._free)
            self._follow(before, item, tracks, free)
        self._before, self._free = item, free
        record = self._record(before or item, item, free)
        return StepResult((record,), (*notices, *self._silence(item, tracks)))

    def _capsules(self) -> dict[int, Capsules]:
        """Return the capsules of all propagated skeletons, by id."""
        return {
            number: axes(self._parts, self._skeleton, own.positions) for number, own in self._people.items()
        }

    def _begin_anew(self, item: TrackedPoseSet) -> None:
        self._people = {
            number: PropagatedJoints.measured(points)
            for number, points in zip(item.ids.tolist(), item.positions)
        }
        self._last, self._surface = no_motions(), no_surface(len(self._names))

    def _follow(
        self, before: TrackedPoseSet, item: TrackedPoseSet, tracks: dict[str, PatchTracks], free: Array
    ) -> None:
        """Update all people and patches from the previous instant to this one.

        Args:
            free: (F, 2) ids and joints in free space, which are treated as not measured.
        """
        dt, config = 1e-9 * (item.stamp_ns - before.stamp_ns), self._config
        maps = [sensed for _, sensed in self._depth.near(before.stamp_ns)]
        lifted = self._tracker.lifted(before, dt, self._people, tracks, maps)
        measured = dict(zip(item.ids.tolist(), item.positions.copy()))
        for person, joint in free.tolist():
            measured[person][joint] = np.nan
        self._last = self._tracker.motions(lifted, self._expected(measured, lifted), self._people, self._last)
        self._carry(measured, dt)
        bodies = self._capsules()
        surface = moved(self._surface, self._last, lifted, bodies, config.life, self._tracker.views)
        new = seeded(surface, self._last, lifted, bodies, self._most, self._next)
        self._next += len(new.ids) - len(surface.ids)
        self._surface = new

    def _expected(self, measured: dict[int, Array], lifted: LiftedTracks) -> dict[tuple[int, int], Array]:
        """Return the motions of parts according to the skeletons, by person and part; see `expectation`."""
        found = {}
        for person, part in lifted.keys:
            if person in measured:
                moves = expectation(self._parts[part], self._people[person].positions, measured[person])
                if moves is not None:
                    found[person, part] = moves
        return found

    def _carry(self, measured: dict[int, Array], dt: float) -> None:
        """Propagate all skeletons, drop people without known joints, and add new people."""
        motions: dict[int, dict[int, tuple[Array, Array]]] = {}
        last = self._last
        both = np.concatenate([last.rotations, last.translations], axis=1)
        for person, part, centre, motion in zip(
            last.people.tolist(), last.parts.tolist(), last.centres, both
        ):
            motions.setdefault(person, {})[part] = centre, motion
        nothing = np.full((len(self._skeleton), 3), np.nan)
        for person, carried in self._people.items():
            shift = carried.displacements(self._parts, motions.get(person, {}))
            own = measured.get(person, nothing)
            carried.take(shift, own, dt, self._config.carry, self._config.carry_gain)
        self._people = {
            person: carried
            for person, carried in self._people.items()
            if np.isfinite(carried.positions).any()
        }
        for person in measured.keys() - self._people.keys():
            self._people[person] = PropagatedJoints.measured(measured[person])

    def _record(self, before: TrackedPoseSet, item: TrackedPoseSet, free: Array) -> PatchTrajectories:
        own = self._surface
        return PatchTrajectories(
            item.index,
            item.stamp_ns,
            before.stamp_ns,
            self._hash,
            own.ids,
            own.ages,
            own.people,
            own.parts,
            own.positions,
            own.normals,
            own.sigmas,
            self._names,
            own.visible,
            self._last,
            free,
        )

    def _silence(self, item: TrackedPoseSet, tracks: dict[str, PatchTracks]) -> tuple[Notice, ...]:
        """Return notices when people have no 2D tracks or no motion for long, and when these resume."""
        if not len(item.ids):
            return ()
        self._silent, notices = _counted(self._silent, bool(tracks), NO_TRACKS)
        if tracks:
            self._blind, more = _counted(self._blind, len(self._last.people) > 0, NO_MOTION)
            notices += more
        return notices


def _counted(count: int, good: bool, said: tuple[Notice, Notice]) -> tuple[int, tuple[Notice, ...]]:
    """Count one more instant, good or bad, after `count` bad ones; return the new count and the notices.

    Each notice of `said` is given once: the first after `SILENT` bad instants, the second when it is good
    again.
    """
    if good:
        return 0, said[1:] if count >= SILENT else ()
    return min(count + 1, SILENT + 1), said[:1] if count + 1 == SILENT else ()


def _examples(context: StageContext) -> Iterator[PatchTracks | TrackedPoseSet]:
    """Yield a few instants of a person before the first camera, with tracks, to compile all kernels."""
    camera, skeleton = context.rig.cameras[0], context.skeleton
    count, rng = len(skeleton), np.random.default_rng(0)
    around = np.array([[0.0, 0.0, 3.0]]) + 0.3 * rng.uniform(-1.0, 1.0, (count, 3))
    joints = (around - camera.cam_from_world.translation) @ camera.cam_from_world.rotation
    ones, eyes = np.ones((1, count)), np.tile(1e-4 * np.eye(3), (1, count, 1, 1))
    middle = np.array(camera.image_size) / 2.0
    for index in range(3):
        if index:
            begins = middle + rng.uniform(-60.0, 60.0, (200, 2))
            yield PatchTracks(
                camera.name,
                index * 40_000_000,
                index,
                (index - 1) * 40_000_000,
                index - 1,
                skeleton.hash,
                begins,
                begins,
                np.tile([4.0, 0.0, 4.0], (200, 1)),
                np.zeros(200),
                np.arange(200) % 8,
            )
        yield TrackedPoseSet(
            index,
            index * 40_000_000,
            skeleton.hash,
            joints[None],
            eyes,
            ones,
            ones,
            JointState.MEASURED * ones,
            np.ones(1),
            ids=np.zeros(1, np.int64),
            sources=ViewSources((camera.name,), np.array([index]), np.zeros((1, 1))),
        )
