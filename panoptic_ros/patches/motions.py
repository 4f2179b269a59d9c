"""Motions of the parts of all people between two instants, from the 2D tracks of all views.

Parts are connected: a limb moves at its joint like the part above it. So the motion of every limb is
corrected by that of the part above it, from the torso outwards. The displacement of the shared joint is a
measurement of the limb's motion, with the covariance of the other motion. If the two contradict each other,
both covariances are too small, and the limb's covariance is enlarged (the ratio of Birge 1932).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import Camera, PartMotions, PatchTracks, Rig, SkeletonModel, TrackedPoseSet
from panoptic_ros.domain.parts import Part
from panoptic_ros.geometry.rotations import rotation_of
from panoptic_ros.patches.carried import PropagatedJoints
from panoptic_ros.patches.config import PatchesConfig
from panoptic_ros.patches.depth_buffer import DepthBuffer, SensorDepthMap
from panoptic_ros.patches.lifting import Capsules, axes, lift
from panoptic_ros.patches.rigid import PartProblems, PartSolution, PointTracks, misses, solved, unsolved

TIE_SIGMA = 0.003  # m, standard deviation between two parts' motions at a joint (its position is rough)
Array = np.ndarray
ODD_INTERVAL = 0.5  # greatest relative difference between a view's image interval and that of instants
AGREEING_SHARE = 0.3  # least share of a part's tracks that must agree with its motion
NEAR_SURFACE = 0.1  # m, greatest distance between a measured surface and the capsule of its part
STILL = 0.0005  # m and rad, least standard deviation of a motion


class PartConnections:
    """Connections of parts: part above, part, and shared joint."""

    def __init__(self, parts: tuple[Part, ...]):
        torso = next((k for k, part in enumerate(parts) if part.name == "torso"), -1)
        self.of: list[tuple[int, int, int]] = []  # part above, part, joint; from the torso outwards
        for k, part in enumerate(parts):
            if part.is_limb and torso >= 0 and part.joints[0] in parts[torso].joints:
                self.of.append((torso, k, part.joints[0]))
        for above, k, _ in tuple(self.of):
            for other, part in enumerate(parts):
                if part.is_limb and part.joints[0] == parts[k].joints[1] and other != above:
                    self.of.append((k, other, part.joints[0]))

    def correct(
        self, rows: Mapping[int, int], joints: Array, centres: Array, motions: Array, covariances: Array
    ) -> None:
        """Correct the motions (M, 6) of one person's parts and their covariances (M, 6, 6), in place.

        Args:
            rows: Row of each part that has a motion.
            joints: (J, 3) m, at the first instant; NaN = unknown.
            centres: (M, 3) m, centres of rotation of the motions.
        """
        for above, part, joint in self.of:
            if above not in rows or part not in rows or not np.isfinite(joints[joint, 0]):
                continue
            first, other = rows[above], rows[part]
            place, joint_above = _at(joints[joint], centres[first], motions[first])
            own, joint_own = _at(joints[joint], centres[other], motions[other])
            spread = joint_above @ covariances[first] @ joint_above.T + TIE_SIGMA**2 * np.eye(3)
            total = joint_own @ covariances[other] @ joint_own.T + spread
            off = place - own
            birge = max(1.0, float(off @ np.linalg.solve(total, off)) / 3.0)
            gain = covariances[other] @ joint_own.T @ np.linalg.inv(total)
            step = gain @ off
            motions[other] = _composed(motions[other], step)
            covariances[other] = birge * (covariances[other] - gain @ joint_own @ covariances[other])


def _at(joint: Array, centre: Array, motion: Array) -> tuple[Array, Array]:
    """Return the displacement (3,) m of a joint (3,) m, and its derivative (3, 6) by the motion.

    The motion changes by a small rotation, multiplied from the left, and a translation.
    """
    rotation = np.empty((3, 3))
    rotation_of(motion[:3], rotation)
    arm = rotation @ (joint - centre)
    jacobian = np.hstack([-np.cross(np.eye(3), arm), np.eye(3)])
    return centre + arm + motion[3:] - joint, jacobian


def _composed(motion: Array, step: Array) -> Array:
    """Return the composition of a motion (6,) with a small one (6,) after it."""
    # to first order in the step, which is far below a tenth of a radian
    half = step[:3] + 0.5 * np.cross(step[:3], motion[:3])
    return np.concatenate([motion[:3] + half, motion[3:] + step[3:]])


class LiftedTracks(NamedTuple):
    """N tracks on people, ordered by part, and the person and part of each."""

    tracks: PointTracks
    normals: Array  # (N, 3) of the surface, at the first instant
    groups: Array  # (N,) index into `keys`
    keys: tuple[tuple[int, int], ...]  # (M) person and part


class PartTracker:
    """Tracker that assigns 2D tracks to people and solves for the motions of their parts."""

    def __init__(self, config: PatchesConfig, rig: Rig, skeleton: SkeletonModel, parts: tuple[Part, ...]):
        self._config, self._rig, self._skeleton, self._parts = config, rig, skeleton, parts
        poses = [camera.cam_from_world for camera in rig.cameras]
        self.views = np.array([np.column_stack([pose.rotation, pose.translation]) for pose in poses])
        self.origins = np.array([-pose.rotation.T @ pose.translation for pose in poses]).reshape(-1, 3)
        self._ties = PartConnections(parts)
        self._buffers = [DepthBuffer(camera) for camera in rig.cameras] if rig.depth_sensors else []
        turn, move = config.turn_sigma, config.move_sigma
        self._spread = np.array([turn, turn, turn, move, move, move])

    def lifted(
        self,
        before: TrackedPoseSet,
        dt: float,
        people: Mapping[int, PropagatedJoints],
        tracks: Mapping[str, PatchTracks],
        maps: Sequence[SensorDepthMap] = (),
    ) -> LiftedTracks:
        """Return the tracks of each camera, on the people of the previous instant, dt s ago.

        Args:
            people: Propagated skeletons at that instant, by id.
            tracks: 2D tracks by camera.
            maps: Maps of depth sensors at that instant.
        """
        ids = [number for number in before.ids.tolist() if number in people]
        bodies = [axes(self._parts, self._skeleton, people[number].positions) for number in ids]
        capsules = Capsules(*(np.concatenate(rows) for rows in zip(*bodies))) if bodies else None
        found: list[tuple[Array, ...]] = []
        if capsules is not None and before.sources is not None:
            row_of = {number: row for row, number in enumerate(before.ids.tolist())}
            rows = [row_of[number] for number in ids]
            for view, camera in enumerate(before.sources.cameras):
                item = tracks.get(camera)
                if item is not None and item.before_number == int(before.sources.frames[view]):
                    found += self._of_view(item, dt, before.sources.persons[rows, view], capsules, maps)
        return self._ordered(found, ids)

    def _of_view(
        self, item: PatchTracks, dt: float, persons: Array, capsules: Capsules, maps: Sequence[SensorDepthMap]
    ) -> Iterator[tuple[Array, ...]]:
        """Yield the tracks of a view that are on people, as one tuple or none.

        It holds points, cameras, targets, information, normals, and the index of each track's capsule.
        """
        share = 1e9 * dt / (item.stamp_ns - item.before_ns)
        if abs(share - 1.0) > ODD_INTERVAL:
            return
        row_of = np.full(max(int(item.persons.max(initial=-1)), int(persons.max(initial=-1))) + 2, -1)
        row_of[persons[persons >= 0]] = np.flatnonzero(persons >= 0)
        rows = row_of[item.persons]
        there = np.flatnonzero((rows >= 0) & (item.parts < len(self._parts)))
        number = self._rig.index(item.camera)
        camera = self._rig.cameras[number]
        begins, ends = item.begins[there].astype(float), item.ends[there].astype(float)
        ends = begins + share * (ends - begins)
        own = rows[there] * len(self._parts) + item.parts[there]
        points, normals, seen = (
            np.zeros((len(there), 3)),
            np.zeros((len(there), 3)),
            np.zeros(len(there), bool),
        )
        if len(there):
            lift(self.origins[number], camera.rays(begins), own, capsules, points, normals, seen)
            if maps:
                view, origin = self.views[number], self.origins[number]
                on_surface(self._buffers[number], maps, view, origin, points, seen)
        targets = camera.intrinsics.undistort(ends).reshape(-1, 2)
        seen &= np.isfinite(targets).all(axis=1)
        information = self._on_plane(item.information[there].astype(float), camera)
        cameras = np.full(len(there), number)
        yield tuple(values[seen] for values in (points, cameras, targets, information, normals, own))

    def _on_plane(self, information: Array, camera: Camera) -> Array:
        """Return information (N, 3) on the plane at distance 1, from px^-2; it includes the model noise."""
        floor = self._config.model_px**2
        xx, xy, yy = information.T
        a, b, c = 1.0 + floor * xx, floor * xy, 1.0 + floor * yy
        matrix = camera.intrinsics.matrix
        fx, fy, whole = matrix[0, 0], matrix[1, 1], a * c - b * b
        rows = (xx * c - xy * b) * fx * fx, (xy * a - xx * b) * fx * fy, (yy * a - xy * b) * fy * fy
        return np.stack([row / whole for row in rows], axis=1)

    def _ordered(self, found: list[tuple[Array, ...]], ids: list[int]) -> LiftedTracks:
        """Return all tracks, sorted by part; parts without a track are left out."""
        none = (
            np.zeros((0, 3)),
            np.zeros(0, int),
            np.zeros((0, 2)),
            np.zeros((0, 3)),
            np.zeros((0, 3)),
            np.zeros(0, int),
        )
        points, cameras, targets, information, normals, own = (
            np.concatenate(values) for values in zip(none, *found)
        )
        order = np.argsort(own, kind="stable")
        kinds, groups = np.unique(own[order], return_inverse=True)
        keys = tuple((ids[k // len(self._parts)], k % len(self._parts)) for k in kinds.tolist())
        nothing = np.full(len(order), np.inf)
        tracks = PointTracks(points[order], cameras[order], targets[order], information[order], nothing)
        return LiftedTracks(tracks, normals[order], groups, keys)

    def _solved(self, lifted: LiftedTracks, bodies: PartProblems) -> PartSolution:
        """Return the motions of all parts, solved for the torsos first.

        A track that also fits the torso's motion, or a point at rest, gets a low weight for a limb that moves
        differently.
        """
        result = unsolved(len(lifted.keys))
        is_torso = np.array([self._parts[part].name == "torso" for _, part in lifted.keys], bool)
        solved(lifted.tracks, bodies, np.flatnonzero(is_torso), self.views, self._spread, result)
        torsos = {lifted.keys[k][0]: k for k in np.flatnonzero(is_torso).tolist()}
        for k in np.flatnonzero(~is_torso).tolist():
            first, last = bodies.starts[k], bodies.starts[k + 1]
            moves = [(bodies.centres[k], np.zeros(6))]
            if lifted.keys[k][0] in torsos:
                torso = torsos[lifted.keys[k][0]]
                moves.append((bodies.centres[torso], result.motions[torso]))
            for centre, motion in moves:
                misses(lifted.tracks, first, last, centre, motion, self.views, lifted.tracks.others)
        solved(lifted.tracks, bodies, np.flatnonzero(~is_torso), self.views, self._spread, result)
        return result

    def motions(
        self,
        lifted: LiftedTracks,
        expected: Mapping[tuple[int, int], Array],
        bodies: Mapping[int, PropagatedJoints],
        last: PartMotions,
    ) -> PartMotions:
        """Return the motions of the parts on which enough tracks agree.

        Args:
            lifted: The tracks.
            expected: (9,) by person and part: rotation vector, middle of the axis before, and after; see
                `expectation`.
            bodies: Skeletons at the first instant, by id.
            last: Motions of the previous interval, which may continue.
        """
        count = len(lifted.keys)
        starts = np.searchsorted(lifted.groups, np.arange(count + 1))
        centres = np.array(
            [lifted.tracks.points[first:end].mean(axis=0) for first, end in pairwise(starts.tolist())]
        ).reshape(-1, 3)
        guesses = np.zeros((count, 3, 6))
        before = {key: k for k, key in enumerate(zip(last.people.tolist(), last.parts.tolist()))}
        for k, key in enumerate(lifted.keys):
            if key in expected:
                guesses[k, 0] = _about(centres[k], expected[key])
            if key in before:
                row = before[key]
                rotation, translation = last.rotations[row], last.translations[row]
                arm = centres[k] - last.centres[row] - translation
                guesses[k, 2] = np.concatenate([rotation, translation + np.cross(rotation, arm)])
        result = self._solved(lifted, PartProblems(starts, centres, guesses))
        totals = np.diff(starts)
        enough = (result.agreeing >= self._config.fewest) & (result.agreeing >= AGREEING_SHARE * totals)
        kept = np.flatnonzero(enough & np.isfinite(result.covariances).all(axis=(1, 2)))
        motions = result.motions[kept]
        covariances = result.covariances[kept] * self._config.correlation
        covariances += STILL**2 * np.eye(6)
        people = np.array([key[0] for key in lifted.keys], np.int64).reshape(-1)[kept]
        parts = np.array([key[1] for key in lifted.keys], np.int32).reshape(-1)[kept]
        for person in dict.fromkeys(people.tolist()):
            rows = {int(parts[row]): row for row in np.flatnonzero(people == person).tolist()}
            self._ties.correct(rows, bodies[person].positions, centres[kept], motions, covariances)
        return PartMotions(
            people,
            parts,
            centres[kept],
            motions[:, :3],
            motions[:, 3:],
            covariances,
            result.agreeing[kept],
            result.spreads[kept],
        )


def on_surface(
    buffer: DepthBuffer,
    maps: Sequence[SensorDepthMap],
    view: Array,
    origin: Array,
    points: Array,
    seen: Array,
) -> None:
    """Move points (N, 3) m to the measured surface near them, in place.

    If the surface is elsewhere, something occludes the point or the part is not there: `seen` (N,) becomes
    False.

    Args:
        view: (3, 4) cam_from_world.
        origin: (3,) m, optical centre of the camera.
    """
    ahead = points @ view[:, :3].T + view[:, 3]
    depths = buffer.depths(buffer.drawn(maps), ahead[:, :2] / np.maximum(ahead[:, 2:], 1e-3))
    known = seen & np.isfinite(depths)
    off = np.where(known, depths - ahead[:, 2], 0.0)
    near = known & (np.abs(off) < NEAR_SURFACE)
    points[near] = origin + (points[near] - origin) * (depths[near] / ahead[near, 2])[:, None]
    seen &= ~known | near


def expectation(part: Part, before: Array, after: Array) -> Array | None:
    """Return the motion of a part according to its joints; None if no joint is known at both instants.

    Args:
        before, after: (J, 3) m, NaN = unknown.

    Returns:
        (9,) rotation vector of the axis, then the middle of the axis before and after.
    """
    joints = list(part.joints)
    both = np.isfinite(before[joints, 0] + after[joints, 0])
    if not both.any():
        return None
    one, other = before[joints][both].mean(axis=0), after[joints][both].mean(axis=0)
    turn = np.zeros(3)
    if part.is_limb and both.all():
        first, last = (_unit(places[joints[1]] - places[joints[0]]) for places in (before, after))
        across = np.cross(first, last)
        sine = float(np.linalg.norm(across))
        if sine > 1e-9:
            turn = across / sine * np.arctan2(sine, first @ last)
    return np.concatenate([turn, one, other])


def no_motions() -> PartMotions:
    """Return motions of no parts."""
    none = np.zeros((0, 3))
    return PartMotions(
        np.zeros(0), np.zeros(0), none, none, none, np.zeros((0, 6, 6)), np.zeros(0), np.zeros(0)
    )


def _about(centre: Array, expected: Array) -> Array:
    """Return the motion (6,) about a centre (3,) m of a part that moves as `expectation` returns."""
    rotation = np.empty((3, 3))
    rotation_of(expected[:3], rotation)
    moved = expected[6:] + rotation @ (centre - expected[3:6])
    return np.concatenate([expected[:3], moved - centre])


def _unit(vector: Array) -> Array:
    unit: Array = vector / max(float(np.linalg.norm(vector)), 1e-9)
    return unit
