"""Health stage: name cameras that were turned or zoomed since the calibration, and correct them if asked."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np

from panoptic_ros.domain import AssociationSet, Camera, Evidence, JointState, Rig, TrackedPoseSet
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.errors import DataError
from panoptic_ros.geometry import Rigid
from panoptic_ros.geometry.rotations import rotations_of
from panoptic_ros.health.config import HealthConfig
from panoptic_ros.health.evidence import add_evidence
from panoptic_ros.health.past import BLOCK_S, SUMS, CameraChange, PastSums, change_of
from panoptic_ros.solving.example import cloud_of_joints
from panoptic_ros.stage import Notice, StageContext, StepResult
from panoptic_ros.state import Fields, Stateful, StateLayout

Array = np.ndarray
SECOND = 1_000_000_000
SPACING_NS = 190_000_000  # ns between two used sets: bias, not noise, limits the result
PAUSE_NS = SECOND  # ns without a set after which all motion is unknown
TRAIL_NS = SECOND // 2  # ns over which the motion of a body is measured
AGREED = 0.25  # share of the gain by which each of two windows must differ in the same direction
LEAST_TEST = 20.0  # limit of `PastSums.tests`: chance exceeds it once in 6000 independent looks of 6 s
WALKING = 0.3  # m/s, slower people stand: sway of the body and gestures stay below
MEASURED = int(JointState.MEASURED)
_Trail = deque[tuple[int, tuple[float, float, float]]]  # timestamps ns, centres of a body m


class HealthStage(Stateful):
    """Stage that compares each camera with its own past, by the joints that the other cameras triangulate.

    Only people who walk count: the detector's bias of a person who stays is that of one pose. A camera is
    named if its rotation or focal length differs from the past by more than the limit, in two successive
    windows of 3 s of walking. A named camera gives no evidence about others until it is repaired, or is as it
    was. A repair takes two more windows, which begin after the change. The stage gives out a corrected rig;
    the graph constructs the stage again with it.
    """

    LAYOUT = StateLayout(
        "health",
        ("_sums", "_trails", "_evidence", "_used_ns", "_named"),
        (Evidence, Fields.named(PastSums, SUMS)),
        same={"configuration": "_config", "cameras": "_rig.names", "skeleton": "_hash"},
    )

    def __init__(self, config: HealthConfig, context: StageContext):
        self._config, self._rig, self._hash = config, context.rig, context.skeleton.hash
        self._names = context.rig.names
        self._arrays = RigArrays.of(context.rig)
        self._keep = float(np.exp(-BLOCK_S / config.memory_s))
        self._limits = np.deg2rad(config.turn_deg), config.zoom
        self.reset()
        if config.active:
            self._compile(cloud_of_joints(context.rig, context.skeleton))
        self.reset()

    def reset(self) -> None:
        """Forget the past of all cameras."""
        self._sums = PastSums(len(self._rig))
        self._trails: dict[int, _Trail] = {}
        self._evidence: tuple[int, Evidence] | None = None
        self._used_ns: int | None = None
        self._named = np.zeros(len(self._rig), bool)  # (C,) cameras that are not as they were

    def flush(self) -> StepResult[Rig]:
        """Reset the stage. It has no buffered records."""
        self.reset()
        return StepResult()

    def step(self, item: AssociationSet | TrackedPoseSet) -> StepResult[Rig]:
        """Take the 2D poses of an instant, or the people who were made from them; return a corrected rig.

        Raises:
            DataError: if the people are of another skeleton.
        """
        if isinstance(item, AssociationSet):
            self._evidence = item.index, item.evidence
            return StepResult()
        if item.skeleton_hash != self._hash:
            raise DataError(f"tracked people of skeleton {item.skeleton_hash}, expected {self._hash}")
        found, self._evidence = self._evidence, None
        since = SPACING_NS if self._used_ns is None else item.stamp_ns - self._used_ns
        if found is None or found[0] != item.index or item.sources is None or 0 <= since < SPACING_NS:
            return StepResult()
        if not 0 <= since <= PAUSE_NS:
            self._trails = {}
        self._used_ns = item.stamp_ns
        walking, velocities = self._motion(item)
        if not walking.any():
            return StepResult()
        self._add(item, found[1], walking, velocities)
        return self._judged(self._sums.close(self._keep))

    def _motion(self, item: TrackedPoseSet) -> tuple[Array, Array]:
        """Return which of P people walk (P,), and the velocities (P, 3) m/s of their bodies."""
        walking = np.zeros(len(item.ids), bool)
        velocities = np.zeros((len(item.ids), 3))
        trails: dict[int, _Trail] = {}
        for p, number in enumerate(item.ids.tolist()):
            there = item.states[p] == MEASURED
            trail = self._trails.get(number, deque())
            if there.any():
                x, y, z = item.positions[p][there].mean(axis=0).tolist()
                trail.append((item.stamp_ns, (x, y, z)))
            while len(trail) > 2 and item.stamp_ns - trail[1][0] >= TRAIL_NS:
                trail.popleft()
            if not trail:
                continue
            trails[number] = trail
            (first, begin), (last, end) = trail[0], trail[-1]
            if last == item.stamp_ns and last - first >= TRAIL_NS:
                velocities[p] = (np.array(end) - begin) * (SECOND / (last - first))
                walking[p] = np.hypot(*velocities[p, :2]) > WALKING
        self._trails = trails
        return walking, velocities

    def _add(self, item: TrackedPoseSet, evidence: Evidence, walking: Array, velocities: Array) -> None:
        """Add the evidence of the people who walk to the current blocks."""
        sources = item.sources
        assert sources is not None
        order = [sources.cameras.index(self._names[c]) for c in evidence.cameras.tolist()]
        positions = np.where((item.states == MEASURED)[..., None], item.positions, np.nan)
        self._add_people(
            evidence,
            np.ascontiguousarray(sources.persons[walking][:, order], np.int64),
            positions[walking],
            velocities[walking],
        )

    def _add_people(self, evidence: Evidence, persons: Array, positions: Array, velocities: Array) -> None:
        sums = self._sums
        seen = np.zeros((len(self._rig), len(positions)), bool)
        add_evidence(
            self._arrays.rotations,
            self._arrays.translations,
            ~self._named,
            evidence.cameras,
            evidence.starts,
            evidence.rows,
            evidence.plane,
            evidence.scores,
            evidence.delays,
            persons,
            positions,
            velocities,
            sums.expected,
            sums.normals,
            sums.vectors,
            seen,
        )
        sums.frames += seen.any(axis=1)

    def _judged(self, cameras: list[int]) -> StepResult[Rig]:
        """Return the notices of cameras whose block has ended, and the rig if it was corrected."""
        sums = self._sums
        are_ready = sums.ready
        ready = [c for c in cameras if are_ready[c]]
        if not ready:
            return StepResult()
        for c in [c for c in ready if self._named[c]]:
            result = self._followed(c)
            if result is not None:
                return result
        gains = np.where(self._named, 0.0, sums.gains.max(axis=1))
        camera = int(gains.argmax())
        if camera not in ready or sums.tests[camera] < LEAST_TEST:
            return StepResult()
        found = change_of(sums, camera)
        limit = self._limits[found.is_zoom]
        if found.size < limit or found.agreed < AGREED:
            return StepResult()
        self._named[camera] = True
        for c in range(len(self._names)):
            sums.restart(c)
        return StepResult(notices=(self._notice(camera, found),))

    def _followed(self, camera: int) -> StepResult[Rig] | None:
        """Return what is to be said about a named camera after two more windows; None = it is as it was."""
        found = change_of(self._sums, camera)
        if found.size < self._limits[found.is_zoom]:
            self._named[camera] = False
            return None
        if not self._config.repair:
            self._sums.restart(camera)
            return StepResult(notices=(self._notice(camera, found),))
        self._named[camera] = False
        for c in range(len(self._names)):
            self._sums.restart(c)
        cameras = list(self._rig.cameras)
        cameras[camera] = corrected(cameras[camera], found)
        text = f"{_described(cameras[camera], found)}; the rig is corrected"
        notice = Notice("health.repaired", "warning", text, {"device": self._names[camera]})
        return StepResult((replace(self._rig, cameras=tuple(cameras)),), (notice,))

    def _notice(self, camera: int, found: CameraChange) -> Notice:
        own = self._rig.cameras[camera]
        code = "health.zoomed" if found.is_zoom else "health.turned"
        more = (
            "it is measured again for the repair"
            if self._config.repair
            else "calibrate again, or use --repair"
        )
        return Notice(code, "warning", f"{_described(own, found)}; {more}", {"device": own.name})

    def _compile(self, joints: Array) -> None:
        """Compile the kernels with a person without 2D poses."""
        none = np.zeros(0, np.int64)
        nobody = np.zeros((0, len(joints)))
        plane = np.zeros((0, len(joints), 2))
        evidence = Evidence(none, none, np.zeros(1, np.int64), none, none, plane, nobody, nobody, np.zeros(0))
        self._add_people(evidence, np.zeros((1, 0), np.int64), joints[None], np.zeros((1, 3)))


def _described(camera: Camera, found: CameraChange) -> str:
    if found.is_zoom:
        return (
            f"camera {camera.name} has zoomed: focal length {np.expm1(found.change[0]):+.1%} against its past"
        )
    turn = np.rad2deg(np.linalg.norm(found.change))
    return f"camera {camera.name} has turned by {turn:.2f} deg against its past"


def corrected(camera: Camera, found: CameraChange) -> Camera:
    """Return the camera after a change: turned about its centre, or with another focal length."""
    if found.is_zoom:
        matrix = camera.intrinsics.matrix.copy()
        matrix[:2, :2] *= np.exp(found.change[0])
        return replace(camera, intrinsics=replace(camera.intrinsics, matrix=matrix))
    turn = rotations_of(found.change[None])[0]
    pose = camera.cam_from_world
    return replace(camera, cam_from_world=Rigid(turn @ pose.rotation, turn @ pose.translation))
