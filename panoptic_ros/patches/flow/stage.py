"""Flow stage: from images and their 2D poses to 2D tracks on these people.

The tracked points form a fixed pattern on every rigid part. Corners are not used, because the rotation of a
part needs points all over it. The texture round each point gives the directions in which it can be tracked
(`tracking`).

The views that see a person share the points. Some views suffice to measure the motion of a part from all
sides, and more views add little. So if many views see a person, each tracks a share of the points, different
from its neighbour's. A person then costs the same in rigs of any size. No camera needs data of another. The
size of a 2D pose gives the approximate distance, and the rig gives the cameras that see this place and the
scale in each.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from panoptic_ros.domain import Camera, PatchTracks, Rig, SkeletonModel, ViewDetections, ViewFrame
from panoptic_ros.domain.parts import Part, rigid_parts
from panoptic_ros.errors import DataError
from panoptic_ros.patches.flow.config import FlowConfig
from panoptic_ros.patches.flow.tracking import followed, ready
from panoptic_ros.stage import Notice, StageContext, StepResult
from panoptic_ros.state import Stateful, StateLayout

ALONG_BORDER = 9  # points on each image border that define the field of view
# least size of a person in another camera that also sees the person, relative to the size in the own camera
LARGE = 0.5
APART = 0.5 * (np.sqrt(5.0) - 1.0)  # phase shift of the point selection from camera to camera (golden ratio)
ALONG, ACROSS = (0.08, 0.36, 0.64, 0.92), (-0.5, 0.5)  # points on a limb: shares of length and radius
TORSO_ALONG, TORSO_ACROSS = (0.0, 0.25, 0.5, 0.75, 1.0), (-0.75, -0.25, 0.25, 0.75)
TORSO_LENGTH = 0.5  # m, from the middle of the shoulders to that of the hips
TORSO_WIDTH = 0.1  # m, least half width of the pattern on a torso
HEAD_RING = 0.055  # m, radius of the pattern on a head
QUANTILE = 0.8  # quantile of the scales of the parts: parts that point at the camera look short
FEWEST = 3  # least number of joints of a person who is tracked
Array = np.ndarray


class PointAllocation:
    """Selection of the points that each camera of a rig tracks.

    Args:
        rig: The cameras.
        views: Number of views that track all points of a person; 0 = all views do.
    """

    def __init__(self, rig: Rig, views: int):
        stack = rig.stack()
        self._rig, self._views = rig, views
        self._rotations, self._translations, self._focals = stack.rotations, stack.translations, stack.focals
        fields = [_field_of_view(camera) for camera in rig.cameras]
        self._lowest, self._highest = (np.array([field[end] for field in fields]) for end in (0, 1))

    def shares(self, camera: str, middles: Array, scales: Array) -> Array:
        """Return the share (P,) of the points on each person that a camera tracks.

        Args:
            middles: (P, 2) px, centres of the people.
            scales: (P,) px per metre; NaN = unknown, the person is not tracked.
        """
        if not 0 < self._views < len(self._rig) or not len(middles):
            return np.ones(len(middles))
        own = self._rig.index(camera)
        depths = self._focals[own] / scales
        plane = self._rig.cameras[own].intrinsics.undistort(middles).reshape(-1, 2)
        ahead = depths[:, None] * np.column_stack([plane, np.ones(len(plane))])
        places = (ahead - self._translations[own]) @ self._rotations[own]
        count = self._seeing(places, LARGE * scales)
        return np.where(count > self._views, self._views / np.maximum(count, 1), 1.0)

    def followed(self, camera: str, persons: Array, shares: Array) -> Array:
        """Return which (N,) of the points on people (N,), ordered by person, are in these shares (P,)."""
        number = np.arange(len(persons)) - np.searchsorted(persons, persons)  # index on the person
        own, phase = shares[persons], self._rig.index(camera) * APART
        chosen: Array = (number * own + phase) % 1.0 < own
        return chosen

    def _seeing(self, places: Array, scales: Array) -> Array:
        """Return the number of cameras (P,) that see places (P, 3) m at a large enough scale.

        Args:
            scales: (P,) px per metre, least scales.
        """
        local = np.einsum("cij,pj->cpi", self._rotations, places) + self._translations[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            plane = local[..., :2] / local[..., 2:]
        inside = (plane >= self._lowest[:, None]) & (plane <= self._highest[:, None])
        near = (local[..., 2] > 0.0) & (local[..., 2] * scales <= self._focals[:, None])
        count: Array = (inside.all(axis=-1) & near).sum(axis=0)
        return count


def _field_of_view(camera: Camera) -> tuple[Array, Array]:
    """Return the least and greatest x and y (2,) on the plane at distance 1 that an image shows."""
    width, height = camera.image_size
    x, y = np.linspace(0.0, width - 1.0, ALONG_BORDER), np.linspace(0.0, height - 1.0, ALONG_BORDER)
    borders = [np.column_stack([x, np.full_like(x, end)]) for end in (0.0, height - 1.0)]
    borders += [np.column_stack([np.full_like(y, end), y]) for end in (0.0, width - 1.0)]
    plane = camera.intrinsics.undistort(np.concatenate(borders)).reshape(-1, 2)
    if not np.isfinite(plane).all():  # a lens whose image shows everything in front of it
        return np.full(2, -np.inf), np.full(2, np.inf)
    return plane.min(axis=0), plane.max(axis=0)


class LaidPoints(NamedTuple):
    """N pattern points on P people.

    Args:
        points: (N, 2) px, ordered by person.
        persons: (N,) person of each point.
        parts: (N,) part of each point.
        middles: (P, 2) px, centres of the people.
        scales: (P,) px per metre. NaN = the person has no points.
    """

    points: Array
    persons: Array
    parts: Array
    middles: Array
    scales: Array


class PointPattern:
    """Pattern of points on the 2D poses of a skeleton."""

    def __init__(self, skeleton: SkeletonModel):
        self.parts = rigid_parts(skeleton)
        names = [name.lower() for name in skeleton.joint_names]
        self._shoulders, self._hips = (
            [j for j, name in enumerate(names) if word in name] for word in ("shoulder", "hip")
        )
        self._has_torso = len(self._shoulders) == 2 and len(self._hips) == 2
        angles = np.arange(6) * np.pi / 3
        ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        self._ring = HEAD_RING * np.concatenate([np.zeros((1, 2)), ring])

    def lay(self, points: Array, there: Array) -> LaidPoints:
        """Return the points on people with joints (P, J, 2) px, of which `there` (P, J) are seen."""
        laid, persons, parts = [np.zeros((0, 2))], [], []
        middles, scales = np.full((len(points), 2), np.nan), np.full(len(points), np.nan)
        for person in np.flatnonzero(there.sum(axis=1) >= FEWEST).tolist():
            own = np.where(there[person, :, None], points[person], np.nan)
            scale = self._scale(own)
            if not np.isfinite(scale):
                continue
            middles[person], scales[person] = np.nanmean(own, axis=0), scale
            for number, part in enumerate(self.parts):
                found = self._on(part, own, scale)
                laid.append(found)
                persons += [person] * len(found)
                parts += [number] * len(found)
        return LaidPoints(
            np.concatenate(laid), np.array(persons, np.int32), np.array(parts, np.int32), middles, scales
        )

    def _scale(self, points: Array) -> float:
        """Return the px per metre of a person with joints (J, 2), NaN = missing; NaN if no part is seen."""
        lengths = [
            np.linalg.norm(points[part.joints[1]] - points[part.joints[0]]) / part.length
            for part in self.parts
            if part.is_limb
        ]
        if self._has_torso:
            axis = points[self._shoulders].mean(axis=0) - points[self._hips].mean(axis=0)
            lengths.append(np.linalg.norm(axis) / TORSO_LENGTH)
        known = [length for length in lengths if np.isfinite(length)]
        return float(np.quantile(known, QUANTILE)) if known else np.nan

    def _on(self, part: Part, points: Array, scale: float) -> Array:
        """Return the points (N, 2) px on a part of a person."""
        if part.name == "head":
            middle = points[list(part.joints)]
            middle = middle[np.isfinite(middle[:, 0])]
            return middle.mean(axis=0) + scale * self._ring if len(middle) else np.zeros((0, 2))
        if part.name == "torso":
            if not self._has_torso:
                return np.zeros((0, 2))
            left, right = self._shoulders[0], self._shoulders[1]
            shoulders, hips = points[self._shoulders].mean(axis=0), points[self._hips].mean(axis=0)
            half = max(0.5 * float(np.linalg.norm(points[left] - points[right])), TORSO_WIDTH * scale)
            return _grid(shoulders, hips, half, TORSO_ALONG, TORSO_ACROSS)
        first, last = points[part.joints[0]], points[part.joints[1]]
        return _grid(first, last, part.radius * scale, ALONG, ACROSS)


def _grid(
    first: Array, last: Array, half: float, along: tuple[float, ...], across: tuple[float, ...]
) -> Array:
    """Return points (N, 2) px between two ends (2,) px, offset sideways by shares of `half` px.

    There are none if an end is NaN.
    """
    axis = last - first
    length = float(np.linalg.norm(axis))
    if not length > 0.0:
        return np.zeros((0, 2))
    side = half / length * np.array([-axis[1], axis[0]])
    steps = first + np.array(along)[:, None] * axis
    grid: Array = (steps[:, None] + np.array(across)[None, :, None] * side).reshape(-1, 2)
    return grid


@dataclass(frozen=True, eq=False)
class CameraPoints:
    """Newest image of a camera, and the points on its people after their detection.

    Args:
        stamp_ns, frame_number: Those of the image.
        grey: (h, w) uint8, grey image of reduced size.
        scale: px of the image per px of the grey image.
        begins: (N, 2) px of the grey image; None before the detection.
        persons, parts: (N,) person and part of each point.
    """

    stamp_ns: int
    frame_number: int
    grey: Array
    scale: float
    begins: Array | None = None
    persons: Array | None = None
    parts: Array | None = None


class FlowStage(Stateful):
    """Stage that tracks points on people from each image of a camera to the next, per camera."""

    LAYOUT = StateLayout(
        "flow", ("_seen",), (CameraPoints,), same={"configuration": "_config", "skeleton": "_hash"}
    )

    def __init__(self, config: FlowConfig, context: StageContext):
        self._config, self._hash = config, context.skeleton.hash
        self._pattern = PointPattern(context.skeleton)
        self._sharing = PointAllocation(context.rig, config.views)
        self._seen: dict[str, CameraPoints] = {}
        ready()

    def reset(self) -> None:
        """Forget all images."""
        self._seen.clear()

    def flush(self) -> StepResult[PatchTracks]:
        """Reset the stage; it buffers no records."""
        self.reset()
        return StepResult()

    def step(self, item: ViewFrame | ViewDetections) -> StepResult[PatchTracks]:
        """Return the tracks from the previous image to this one, or accept the 2D poses of the newest image.

        The 2D poses define the points that are tracked to the next image.

        Raises:
            DataError: if the 2D poses have another skeleton.
        """
        if isinstance(item, ViewDetections):
            self._take_people(item)
            return StepResult()
        before, now = self._seen.get(item.camera), self._made_small(item)
        if before is not None and item.stamp_ns <= before.stamp_ns:
            text = f"camera {item.camera}: image {item.frame_number} is not newer than the previous one"
            return StepResult(notices=(Notice("flow.old_stamp", "warning", text),))
        self._seen[item.camera] = now
        if before is None or before.begins is None or before.grey.shape != now.grey.shape:
            return StepResult()
        if 1e-9 * (now.stamp_ns - before.stamp_ns) > self._config.longest_gap:
            return StepResult()
        return StepResult((self._tracks(item, before, now),))

    def _made_small(self, item: ViewFrame) -> CameraPoints:
        image = item.image
        shrink = max(1.0, image.shape[1] / self._config.width)
        if shrink > 1.0:
            size = (round(image.shape[1] / shrink), max(1, round(image.shape[0] / shrink)))
            image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        return CameraPoints(item.stamp_ns, item.frame_number, grey, item.image.shape[1] / grey.shape[1])

    def _take_people(self, item: ViewDetections) -> None:
        if item.skeleton_hash != self._hash:
            raise DataError(f"2D people of skeleton {item.skeleton_hash}, but flow works on {self._hash}")
        seen = self._seen.get(item.camera)
        if seen is None or seen.frame_number != item.frame_number or seen.stamp_ns != item.stamp_ns:
            return
        laid = self._pattern.lay(item.points, item.scores > 0.0)
        shares = self._sharing.shares(item.camera, laid.middles, laid.scales)
        kept = self._sharing.followed(item.camera, laid.persons, shares)
        begins = (laid.points[kept] + 0.5) / seen.scale - 0.5
        self._seen[item.camera] = CameraPoints(
            seen.stamp_ns,
            seen.frame_number,
            seen.grey,
            seen.scale,
            begins,
            laid.persons[kept],
            laid.parts[kept],
        )

    def _tracks(self, item: ViewFrame, before: CameraPoints, now: CameraPoints) -> PatchTracks:
        assert before.begins is not None and before.persons is not None and before.parts is not None
        ends, information, kept = followed(before.grey, now.grey, before.begins, before.begins)
        begins, scale = before.begins[kept], before.scale
        return PatchTracks(
            item.camera,
            item.stamp_ns,
            item.frame_number,
            before.stamp_ns,
            before.frame_number,
            self._hash,
            (begins + 0.5) * scale - 0.5,
            (ends + 0.5) * scale - 0.5,
            information / scale**2,
            before.persons[kept],
            before.parts[kept],
        )
