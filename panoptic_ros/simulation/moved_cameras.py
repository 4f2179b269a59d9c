"""Cameras that turn or zoom during a take, seen by a detector with persistent bias."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from panoptic_ros.domain import Camera, DetectionSet
from panoptic_ros.geometry import Rigid
from panoptic_ros.geometry.rotations import rotations_of
from panoptic_ros.simulation.detector import Sightings
from panoptic_ros.simulation.simulate import Simulation, view_of
from panoptic_ros.simulation.skeleton import JOINTS, SKELETON, J

Array = np.ndarray
HARMONICS = 2  # number of harmonics in the angle between body and camera


@dataclass(frozen=True)
class CameraEvent:
    """Change of a camera at an instant.

    Args:
        time_s: Time since the first instant.
        camera: Index.
        turn: Rotation vector (rad) in the camera's axes.
        zoom: Ratio of focal lengths.
    """

    time_s: float
    camera: int
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0)
    zoom: float = 1.0

    def applied(self, camera: Camera) -> Camera:
        """Return the camera after the event."""
        turn = rotations_of(np.array(self.turn)[None])[0]
        pose, matrix = camera.cam_from_world, camera.intrinsics.matrix.copy()
        matrix[:2, :2] *= self.zoom
        return replace(
            camera,
            intrinsics=replace(camera.intrinsics, matrix=matrix),
            cam_from_world=Rigid(turn @ pose.rotation, turn @ pose.translation),
        )


class DetectorBias:
    """Systematic error of 2D joints, m at the depth of the person.

    Args:
        size: Standard deviation per image axis, m.
        turning: Whether the error depends on the angle between body and camera (two harmonics, half of the
            variance common to all people). Otherwise every camera, person and joint has a constant error.
    """

    def __init__(self, seed: int, cameras: int, people: int, size: float, turning: bool):
        rng = np.random.default_rng([seed, 6])
        self._turning = turning
        if turning:
            shape = (len(JOINTS), 2, 2 * HARMONICS + 1)
            own, common = rng.standard_normal((people, *shape)), rng.standard_normal(shape)
            self._terms = size * np.sqrt(0.5 / (HARMONICS + 1)) * (own + common)
        else:
            self._terms = size * rng.standard_normal((cameras, people, len(JOINTS), 2))

    def of(self, camera: int, person: int, angle: float) -> Array:
        """Return the errors (19, 2) m of a person seen at an angle (rad)."""
        if not self._turning:
            constant: Array = self._terms[camera, person]
            return constant
        waves = [f(k * angle) for k in range(1, HARMONICS + 1) for f in (np.cos, np.sin)]
        errors: Array = self._terms[person] @ np.array([1.0, *waves])
        return errors


def moved_camera_sets(
    take: Simulation, bias: DetectorBias, event: CameraEvent | None = None
) -> Iterator[DetectionSet]:
    """Yield the detections of a take whose cameras share one clock; from the event on, one camera differs."""
    cameras = take.rig.cameras
    moved = take
    if event is not None:
        after = list(cameras)
        after[event.camera] = event.applied(cameras[event.camera])
        moved = replace(take, rig=replace(take.rig, cameras=tuple(after)))
    people = [person.joints(take.schedule.ticks) for person in take.people]
    for (index, before), (_, late) in zip(take.sightings(), moved.sightings()):
        tick = take.schedule.ticks[index]
        seen = before if event is None or tick < event.time_s else late
        joints = [own[index] for own in people]
        views = [
            view_of(
                camera.name,
                camera.image_size,
                index,
                take.stamp_ns(k, take.schedule.stamps[index][k]),
                _biased(camera, k, seen[k], joints, bias),
                SKELETON.hash,
            )
            for k, camera in enumerate(cameras)
        ]
        yield DetectionSet(index, take.master_ns(tick), SKELETON.hash, tuple(views))


def _biased(
    camera: Camera, number: int, seen: Sightings, people: list[Array], bias: DetectorBias
) -> Sightings:
    """Return the sightings of a camera with the errors of the detector; outliers and ghosts stay."""
    points = seen.points.copy()
    for person, joints in enumerate(people):
        body, hips = joints[J["BodyCenter"]], joints[J["lHip"]] - joints[J["rHip"]]
        away = camera.centre - body
        angle = np.arctan2(away[1], away[0]) - np.arctan2(hips[1], hips[0])
        pixels = camera.intrinsics.matrix[0, 0] / camera.cam_from_world.apply(body[None])[0, 2]
        errors = pixels * bias.of(number, person, float(angle))
        rows, columns = np.nonzero(seen.sources[..., 0] == person)
        points[rows, columns] += errors[seen.sources[rows, columns, 1]]
    return replace(seen, points=points)
