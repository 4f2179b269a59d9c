"""Surface patches on people: their motion in one image, and in 3D."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain.checks import ShapeChecks, check_magnitude, check_stamp
from panoptic_ros.errors import DataError

Array = np.ndarray
FARTHEST_PX = 1e6  # px, beyond any image
FARTHEST_M = 1e6


@dataclass(frozen=True, slots=True, eq=False)
class PatchTracks:
    """Motion of N points on the people of an image to the next image of the same camera.

    Args:
        camera: Name of the camera.
        stamp_ns, frame_number: Timestamp and number of the newer image.
        before_ns, before_number: Those of the older image.
        skeleton_hash: `SkeletonModel.hash` of the skeleton that defines the parts.
        begins, ends: (N, 2) px in the older and in the newer image.
        information: (N, 3) px^-2: xx, xy, yy of the inverse covariance of an end.
        persons: (N,) index into the people of the older image's `ViewDetections`.
        parts: (N,) index into `domain.parts.rigid_parts` of the skeleton.

    Raises:
        DataError: on shapes that do not fit, points that are not finite, or negative information (xx or yy).
    """

    camera: str
    stamp_ns: int
    frame_number: int
    before_ns: int
    before_number: int
    skeleton_hash: str
    begins: Array
    ends: Array
    information: Array
    persons: Array
    parts: Array

    def __post_init__(self) -> None:
        if not self.camera:
            raise DataError("PatchTracks without the name of its camera")
        object.__setattr__(self, "stamp_ns", check_stamp(self, self.stamp_ns))
        object.__setattr__(self, "before_ns", check_stamp(self, self.before_ns, "before_ns"))
        if self.before_ns >= self.stamp_ns:
            raise DataError(f"PatchTracks of camera {self.camera} lead back in time")
        shapes = ShapeChecks(self)
        for name, letters in (("begins", "N 2"), ("ends", "N 2"), ("information", "N 3")):
            values = shapes.store(name, np.float32, letters)
            if not np.isfinite(values).all():
                raise DataError(f"PatchTracks.{name} of camera {self.camera} is not finite")
            check_magnitude(f"PatchTracks.{name} of camera {self.camera}", values, FARTHEST_PX)
        if self.information.size and (self.information[:, ::2] < 0.0).any():
            raise DataError(f"PatchTracks.information of camera {self.camera} is negative")
        for name in ("persons", "parts"):
            indices = shapes.store(name, np.int32, "N")
            if indices.size and indices.min() < 0:
                raise DataError(f"PatchTracks.{name} of camera {self.camera} has the index {indices.min()}")


@dataclass(frozen=True, slots=True, eq=False)
class PartMotions:
    """Motion of M rigid parts of people since the previous instant: x becomes o + t + R (x - o).

    Args:
        people: (M,) ids.
        parts: (M,) index into `domain.parts.rigid_parts` of the skeleton.
        centres: (M, 3) m, o.
        rotations: (M, 3) rad, rotation vectors of R.
        translations: (M, 3) m, t.
        covariances: (M, 6, 6) of (small world rotation, multiplied from the left; translation).
        tracks: (M,) number of 2D tracks that agree with the motion.
        residuals: (M,) root mean square residual of these, in standard deviations of the tracks: the quality
            of the part at this instant.
    """

    people: Array
    parts: Array
    centres: Array
    rotations: Array
    translations: Array
    covariances: Array
    tracks: Array
    residuals: Array

    def __post_init__(self) -> None:
        shapes = ShapeChecks(self)
        shapes.store("people", np.int64, "M")
        shapes.store("parts", np.int32, "M")
        shapes.store("tracks", np.int32, "M")
        shapes.store("residuals", np.float64, "M")
        for name in ("centres", "rotations", "translations"):
            check_magnitude(f"PartMotions.{name}", shapes.store(name, np.float64, "M 3"), FARTHEST_M)
        shapes.store("covariances", np.float64, "M 6 6")
        for name in ("centres", "rotations", "translations", "covariances", "residuals"):
            if not np.isfinite(getattr(self, name)).all():
                raise DataError(f"PartMotions.{name} is not finite")


@dataclass(frozen=True, slots=True, eq=False)
class PatchTrajectories:
    """N surface patches of people at one instant, and the motion of parts since the previous instant.

    Args:
        index, stamp_ns: Those of the skeletons.
        before_ns: Timestamp of the previous instant; the first instant has its own.
        skeleton_hash: `SkeletonModel.hash`.
        ids: (N,) patch ids; one id is the same patch over time.
        ages: (N,) number of instants that the patch has been tracked.
        people: (N,) id of the person.
        parts: (N,) index into `domain.parts.rigid_parts`.
        positions: (N, 3) m.
        normals: (N, 3) unit vectors, pointing out of the body.
        sigmas: (N,) m, standard deviation of the last displacement.
        cameras: (C,) names.
        visible: (N, C) in 0..1, probability that the camera sees the patch.
        motions: Motions of parts. Parts without an entry could not be tracked.
        free: (F, 2) person id and joint, for joints that lie in free space according to depth.

    Raises:
        DataError: on shapes that do not fit and values that are not finite.
    """

    index: int
    stamp_ns: int
    before_ns: int
    skeleton_hash: str
    ids: Array
    ages: Array
    people: Array
    parts: Array
    positions: Array
    normals: Array
    sigmas: Array
    cameras: tuple[str, ...]
    visible: Array
    motions: PartMotions
    free: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "stamp_ns", check_stamp(self, self.stamp_ns))
        object.__setattr__(self, "before_ns", check_stamp(self, self.before_ns, "before_ns"))
        object.__setattr__(self, "cameras", tuple(str(name) for name in self.cameras))
        shapes = ShapeChecks(self)
        for name, kind, letters in (
            ("ids", np.int64, "N"),
            ("ages", np.int32, "N"),
            ("people", np.int64, "N"),
            ("parts", np.int32, "N"),
            ("free", np.int64, "F 2"),
        ):
            shapes.store(name, kind, letters)
        for name, letters in (("positions", "N 3"), ("normals", "N 3"), ("sigmas", "N"), ("visible", "N C")):
            values = shapes.store(name, np.float32, letters)
            if not np.isfinite(values).all():
                raise DataError(f"PatchTrajectories.{name} is not finite")
            check_magnitude(f"PatchTrajectories.{name}", values, FARTHEST_M)
        if self.visible.shape[1] != len(self.cameras):
            raise DataError(f"visibility in {self.visible.shape[1]} views of {len(self.cameras)} cameras")
