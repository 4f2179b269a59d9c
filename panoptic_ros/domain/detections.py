"""Images, depth maps and previews of cameras, and detections in images."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain.checks import ShapeChecks, check_magnitude, check_missing, check_scores, check_stamp
from panoptic_ros.domain.visibility import VisibilityLimit
from panoptic_ros.errors import DataError

Array = np.ndarray
FARTHEST = 1000  # limit of points in larger image sides: no person beside the camera projects farther


@dataclass(frozen=True, slots=True, eq=False)
class ViewFrame:
    """One image of one camera.

    Args:
        stamp_ns: Mid-exposure, on the camera's clock.
        frame_number: Counts the frames that the device gave, so that gaps are visible.
        image: (H, W, 3) uint8, BGR. Not copied; a read-only view is kept.
    """

    camera: str
    stamp_ns: int
    frame_number: int
    image: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "stamp_ns", check_stamp(self, self.stamp_ns))
        image = np.asarray(self.image)
        if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3 or not image.size:
            raise DataError(
                f"image of camera {self.camera}: {image.dtype} {image.shape}, expected uint8 (H, W, 3)"
            )
        object.__setattr__(self, "image", _read_only(image))

    @property
    def image_size(self) -> tuple[int, int]:
        """Return width, height in px."""
        return self.image.shape[1], self.image.shape[0]


def _read_only(array: Array) -> Array:
    view = array.view()
    view.flags.writeable = False
    return view


@dataclass(frozen=True, slots=True, eq=False)
class ScoreMaps:
    """Score maps as sparse patches on the network's grid; 0 outside the patches.

    Several patches may belong to one joint. Where they overlap, the largest value counts (h_j = max_i h_ij,
    Joo et al. 2017, 5.1).

    Args:
        grid_size: (width, height) in cells.
        grid_from_image: (2, 3) affine map A from pixels to cell coordinates (the centre of the first cell is
            0, 0): cell = A[:, :2] @ pixel + A[:, 2]. Bilinear sampling there gives the score.
        joints: (N,) joint of each patch, index into the working skeleton.
        persons: (N,) index into the view's persons, -1 = merged over people.
        corners: (N, 2) first column and row.
        sizes: (N, 2) number of columns and rows.
        data: (B,) uint8, the patches' rows one after another; value / 255 is the score.
    """

    grid_size: tuple[int, int]
    grid_from_image: Array
    joints: Array
    persons: Array
    corners: Array
    sizes: Array
    data: Array

    def __post_init__(self) -> None:
        shapes = ShapeChecks(self)
        affine = shapes.store("grid_from_image", np.float64, "2 3")
        joints = shapes.store("joints", np.int32, "N")
        shapes.store("persons", np.int32, "N")
        corners = shapes.store("corners", np.int32, "N 2")
        sizes = shapes.store("sizes", np.int32, "N 2")
        data = shapes.store("data", np.uint8, "B")
        width, height = (int(value) for value in self.grid_size)
        object.__setattr__(self, "grid_size", (width, height))
        if width <= 0 or height <= 0:
            raise DataError(f"ScoreMaps.grid_size = {width} x {height}")
        if not np.isfinite(affine).all():
            raise DataError("ScoreMaps.grid_from_image is not finite")
        if not affine[0, 0] * affine[1, 1] - affine[0, 1] * affine[1, 0]:
            raise DataError("ScoreMaps.grid_from_image maps the image to a line")
        if joints.size and joints.min() < 0:
            raise DataError("ScoreMaps.joints has a negative joint")
        if corners.size and (
            corners.min() < 0 or sizes.min() < 1 or (corners + sizes > (width, height)).any()
        ):
            raise DataError("ScoreMaps has a patch outside of its grid")
        expected = int(sizes.prod(1, dtype=np.int64).sum())
        if data.size != expected:
            raise DataError(f"ScoreMaps.data has {data.size} bytes, its patches need {expected}")

    def dense(self, joint_count: int) -> Array:
        """Return merged maps (J, height, width) uint8: the maximum over the patches of each joint.

        Raises:
            DataError: if a patch belongs to a joint beyond `joint_count`.
        """
        if self.joints.size and self.joints.max() >= joint_count:
            raise DataError(f"ScoreMaps.joints has joint {self.joints.max()} of {joint_count}")
        maps = np.zeros((joint_count, self.grid_size[1], self.grid_size[0]), np.uint8)
        start = 0
        for joint, (x, y), (w, h) in zip(self.joints, self.corners, self.sizes):
            patch = self.data[start : start + w * h].reshape(h, w)
            window = maps[joint, y : y + h, x : x + w]
            np.maximum(window, patch, out=window)
            start += w * h
        return maps


@dataclass(frozen=True, slots=True, eq=False)
class ViewDetections:
    """2D poses that a detector found in one image, in the joints of the working skeleton.

    Args:
        stamp_ns, frame_number: Those of the image.
        image_size: (width, height) px.
        skeleton_hash: `SkeletonModel.hash`.
        points: (P, J, 2) px, NaN where the joint is missing.
        scores: (P, J) in 0..1, 0 where missing.
        person_scores: (P,) in 0..1.
        maps: Score maps, or None if the detector has none.
        limit: Depth limit of the view, or None if only the image borders limit it.
        carried: (P,) s, time since the image in which the detector found the person. Motion between the
            images propagated the 2D pose since then. 0 = detected in this image. None = all were detected in
            this image. Propagated poses state the position of a known person, but are not evidence that a
            person is there.
    """

    camera: str
    stamp_ns: int
    frame_number: int
    image_size: tuple[int, int]
    skeleton_hash: str
    points: Array
    scores: Array
    person_scores: Array
    maps: ScoreMaps | None = None
    limit: VisibilityLimit | None = None
    carried: Array | None = None

    def __post_init__(self) -> None:
        if not self.camera:
            raise DataError("ViewDetections without the name of its camera")
        object.__setattr__(self, "stamp_ns", check_stamp(self, self.stamp_ns))
        width, height = (int(value) for value in self.image_size)
        if width <= 0 or height <= 0:
            raise DataError(f"ViewDetections.image_size = {width} x {height} of camera {self.camera}")
        object.__setattr__(self, "image_size", (width, height))
        shapes = ShapeChecks(self)
        points = shapes.store("points", np.float64, "P J 2")
        scores = shapes.store("scores", np.float64, "P J")
        check_scores(self, "scores", scores)
        check_scores(self, "person_scores", shapes.store("person_scores", np.float64, "P"))
        check_missing(self, "points", points, scores)
        if self.carried is not None:
            ages = shapes.store("carried", np.float64, "P")
            if not (ages >= 0.0).all() or not np.isfinite(ages).all():
                raise DataError(f"ViewDetections.carried of camera {self.camera} has times below 0, or none")
        limit = float(FARTHEST * max(width, height))
        check_magnitude(f"ViewDetections.points of camera {self.camera}", points, limit, "px")
        if self.maps is not None and self.maps.persons.size:
            if not -1 <= self.maps.persons.min() <= self.maps.persons.max() < len(points):
                raise DataError("ScoreMaps.persons does not fit the persons of its view")


@dataclass(frozen=True, slots=True, eq=False)
class EndOfStream:
    """Marker that no more frames will come from this camera (replay only)."""

    camera: str


@dataclass(frozen=True, slots=True, eq=False)
class DetectionSet:
    """Views of one instant. A camera without an image is absent.

    Args:
        index: Counts the sets from 0.
        stamp_ns: The instant, on the master clock.
        views: Views in the order of the rig, each camera at most once. Every view keeps its own timestamp.
    """

    index: int
    stamp_ns: int
    skeleton_hash: str
    views: tuple[ViewDetections, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "stamp_ns", check_stamp(self, self.stamp_ns))
        object.__setattr__(self, "views", tuple(self.views))
        names = [view.camera for view in self.views]
        if len(set(names)) != len(names):
            raise DataError(f"DetectionSet at {self.stamp_ns} has a camera twice: {', '.join(names)}")
        for view in self.views:
            if view.skeleton_hash != self.skeleton_hash:
                raise DataError(
                    f"camera {view.camera} has skeleton {view.skeleton_hash}, but the set has "
                    f"{self.skeleton_hash}"
                )


@dataclass(frozen=True, slots=True, eq=False)
class Preview:
    """Small preview image of one camera: for display to users, never for a stage.

    Args:
        stamp_ns: Timestamp of the image, on the camera's clock.
        jpeg: The whole image, with the lens's distortion; pixels scale with its size.
    """

    camera: str
    stamp_ns: int
    jpeg: bytes

    def __post_init__(self) -> None:
        object.__setattr__(self, "stamp_ns", check_stamp(self, self.stamp_ns))
        if self.jpeg[:2] != b"\xff\xd8":
            raise DataError(f"the preview of camera {self.camera} is not a JPEG")


@dataclass(frozen=True, slots=True, eq=False)
class DepthFrame:
    """One depth map of a depth sensor, or of a camera to which depth is registered.

    Args:
        camera: Name of the depth sensor or of the camera.
        stamp_ns: Mid-exposure, on the clock of that sensor or camera.
        frame_number: Counts the maps that the device gave, so that gaps are visible.
        depth: (h, w) float32 m along the z axis of the sensor or camera; 0 and values that are not finite =
            unknown (REP 118). Not copied; a read-only view is kept.

    Raises:
        DataError: without a name, or on another type or shape.
    """

    camera: str
    stamp_ns: int
    frame_number: int
    depth: Array

    def __post_init__(self) -> None:
        if not self.camera:
            raise DataError("DepthFrame without the name of its camera or sensor")
        object.__setattr__(self, "stamp_ns", check_stamp(self, self.stamp_ns))
        depth = np.asarray(self.depth)
        if depth.dtype != np.float32 or depth.ndim != 2 or not depth.size:
            found = f"{depth.dtype} {depth.shape}"
            raise DataError(f"depth map of {self.camera}: {found}, expected float32 (h, w)")
        view = depth.view()
        view.flags.writeable = False
        object.__setattr__(self, "depth", view)

    @property
    def image_size(self) -> tuple[int, int]:
        """Return width, height in px."""
        return self.depth.shape[1], self.depth.shape[0]

    def check_image(self, image_size: tuple[int, int]) -> None:
        """Check that the map can be registered to an image: both have the same aspect ratio.

        Args:
            image_size: (width, height) px of the image.

        Raises:
            DataError: if the aspect ratios differ.
        """
        (width, height), (columns, rows) = image_size, self.image_size
        if abs(columns * height - rows * width) > max(width, height):
            raise DataError(
                f"depth map of camera {self.camera} has {columns} x {rows} pixels, its image {width} x "
                f"{height}: another shape; register the depth to the colour camera"
            )
