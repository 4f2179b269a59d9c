"""What votes mean, in numpy: the oracle of the kernels of voting.

A score field tells how likely a joint of a kind lies at a pixel, from score maps or from keypoints: h_j(z) =
max_i h_ij(z) in Joo et al. 2017, 5.1. `vote_reference` is their eq. 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from panoptic_ros.domain import Camera, ScoreMaps, ViewDetections

Array = np.ndarray
GAUSSIAN_END = 6.0  # half of the squared distance in standard deviations beyond which a Gaussian is 0
MIN_WIDTH = 0.002  # least standard deviation of a keypoint, as a fraction of the image's diagonal
MIN_ASPECT = 0.25  # a person's box is taken to be at least so wide, relative to its longer side


class ScoreField(Protocol):
    """The scores of one view. Pixels (N, 2) are those of the original, distorted image."""

    def sample(self, joint: int, pixels: Array) -> Array:
        """Merged scores (N,) in 0..1 of a joint; 0 outside of the image."""

    def sample_person(self, person: int, joint: int, pixels: Array) -> Array:
        """Scores (N,) in 0..1 of a joint of one 2D person."""


def keypoint_widths(
    points: Array, image_size: tuple[int, int] | tuple[Array, Array], relative: float
) -> Array:
    """Standard deviations (P,) px of the joints of people (P, J, 2), NaN where missing.

    `relative` times the square root of the area of the box round the person's joints, and not below
    `MIN_WIDTH` of the diagonal of the image, or of each person's image.
    """
    floor = MIN_WIDTH * np.hypot(*image_size)
    there = np.isfinite(points).all(-1, keepdims=True)
    low = np.where(there, points, np.inf).min(axis=1, initial=np.inf)
    high = np.where(there, points, -np.inf).max(axis=1, initial=-np.inf)
    sides = np.sort(np.maximum(high - low, 0.0), axis=-1)
    area = np.maximum(sides[:, 0], MIN_ASPECT * sides[:, 1]) * sides[:, 1]
    sigmas: Array = np.maximum(relative * np.sqrt(area), floor)
    return sigmas


@dataclass(frozen=True, slots=True, eq=False)
class KeypointField:
    """A Gaussian times its score per joint, the maximum over people.

    Args:
        points: (P, J, 2) px, NaN where missing; scores: (P, J); widths: (P,) px.
    """

    points: Array
    scores: Array
    widths: Array

    def sample(self, joint: int, pixels: Array) -> Array:
        """See `ScoreField`."""
        best = np.zeros(len(pixels))
        for person in range(len(self.points)):
            best = np.maximum(best, self.sample_person(person, joint, pixels))
        return best

    def sample_person(self, person: int, joint: int, pixels: Array) -> Array:
        """See `ScoreField`."""
        square = ((pixels - self.points[person, joint]) ** 2).sum(-1)
        exponent = square / (2.0 * self.widths[person] ** 2)
        near = exponent < GAUSSIAN_END  # False where the joint is missing
        return np.where(near, self.scores[person, joint] * np.exp(-np.where(near, exponent, 0.0)), 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class MapField:
    """Bilinear samples of score maps.

    Patches of one person count for that person; merged ones count for everybody whose joint is
    within the gate.

    Args:
        points: (P, J, 2) px; gates: (P,) px.
    """

    maps: ScoreMaps
    points: Array
    gates: Array

    def sample(self, joint: int, pixels: Array) -> Array:
        """See `ScoreField`."""
        return self._bilinear(self._cells(joint, range(-1, len(self.points))), pixels)

    def sample_person(self, person: int, joint: int, pixels: Array) -> Array:
        """See `ScoreField`."""
        square = ((pixels - self.points[person, joint]) ** 2).sum(-1)
        near = square <= self.gates[person] ** 2
        own = self._bilinear(self._cells(joint, (person,)), pixels)
        return np.where(near, self._bilinear(self._cells(joint, (person, -1)), pixels), own)

    def covers(self, pixels: Array) -> Array:
        """Whether pixels (N, 2) lie on the grid (N,), whose border is half a cell outside."""
        cells = self._cell_coordinates(pixels)
        covered: Array = np.all((cells >= -0.5) & (cells <= np.array(self.maps.grid_size) - 0.5), axis=-1)
        return covered

    def _cell_coordinates(self, pixels: Array) -> Array:
        affine = self.maps.grid_from_image
        cells: Array = pixels @ affine[:, :2].T + affine[:, 2]
        return cells

    def _cells(self, joint: int, persons: tuple[int, ...] | range) -> Array:
        """The map (height, width) of a joint made of the patches of these persons."""
        maps = self.maps
        width, height = maps.grid_size
        cells = np.zeros((height, width))
        ends = np.cumsum(maps.sizes.prod(1, dtype=np.int64))
        for k in np.flatnonzero(maps.joints == joint):
            if maps.persons[k] in persons:
                (x, y), (w, h) = maps.corners[k], maps.sizes[k]
                patch = maps.data[ends[k] - w * h : ends[k]].reshape(h, w)
                window = cells[y : y + h, x : x + w]
                np.maximum(window, patch, out=window)
        return cells / 255.0

    def _bilinear(self, cells: Array, pixels: Array) -> Array:
        height, width = cells.shape
        at = self._cell_coordinates(pixels)
        inside = np.all((at >= -0.5) & (at <= (width - 0.5, height - 0.5)), axis=-1)
        at = np.clip(np.where(inside[:, None], at, 0.0), 0.0, (width - 1.0, height - 1.0))
        low = np.minimum(at.astype(np.int64), (max(width - 2, 0), max(height - 2, 0)))
        high = np.minimum(low + 1, (width - 1, height - 1))
        u, v = (at - low).T
        top = cells[low[:, 1], low[:, 0]] * (1.0 - u) + cells[low[:, 1], high[:, 0]] * u
        bottom = cells[high[:, 1], low[:, 0]] * (1.0 - u) + cells[high[:, 1], high[:, 0]] * u
        return np.where(inside, top * (1.0 - v) + bottom * v, 0.0)


class ViewField:
    """The field of one view: maps for the joints that have patches in it, keypoints for the others.

    Args:
        relative_width: see `keypoint_widths`.
        gate: in standard deviations of a keypoint, for maps of all people.
    """

    def __init__(self, view: ViewDetections, relative_width: float = 0.03, gate: float = 4.0):
        widths = keypoint_widths(view.points, view.image_size, relative_width)
        self.image_size = view.image_size
        self.keypoints = KeypointField(view.points, view.scores, widths)
        self.maps = None if view.maps is None else MapField(view.maps, view.points, gate * widths)
        self.limit = view.limit
        self.mapped = frozenset(() if view.maps is None else view.maps.joints.tolist())

    def sample(self, joint: int, pixels: Array) -> Array:
        """See `ScoreField`."""
        return np.where(self.covers(pixels), self._field(joint).sample(joint, pixels), 0.0)

    def sample_person(self, person: int, joint: int, pixels: Array) -> Array:
        """See `ScoreField`."""
        values = self._field(joint).sample_person(person, joint, pixels)
        return np.where(self.covers(pixels), values, 0.0)

    def covers(self, pixels: Array) -> Array:
        """Whether the view can say something at pixels (N, 2): inside of the image and of the maps."""
        inside: Array = np.all((pixels >= -0.5) & (pixels <= np.array(self.image_size) - 0.5), axis=-1)
        return inside if self.maps is None else inside & self.maps.covers(pixels)

    def sees(self, pixels: Array, depths: Array) -> Array:
        """Whether the view sees points at pixels (N, 2) and depths (N,) m: covered, and not hidden."""
        covered = self.covers(pixels)
        if self.limit is None:
            return covered
        pixels = np.where(covered[:, None], pixels, 0.0)
        seen: Array = covered & self.limit.sees(pixels, depths, self.image_size)
        return seen

    def _field(self, joint: int) -> ScoreField:
        return self.maps if self.maps is not None and joint in self.mapped else self.keypoints


def vote_reference(
    fields: Sequence[ViewField],
    cameras: Sequence[Camera],
    joint: int,
    points: Array,
    view_threshold: float = 0.1,
) -> tuple[Array, Array]:
    """Eq. 1 in numpy: votes (N,) of a joint at points (N, 3) m, and numbers of supporting views (N,).

    The mean over the views that see the point: in front of the camera, inside of the image and of the maps,
    and not beyond the view's limit (see `VisibilityLimit`); 0 where no view does. A view supports a point
    if its score is above `view_threshold`.
    """
    total, seeing = np.zeros(len(points)), np.zeros(len(points), np.int64)
    support = np.zeros(len(points), np.int64)
    for field, camera in zip(fields, cameras):
        pixels, ahead = camera.project(points)
        seen = ahead & field.sees(pixels, camera.cam_from_world.apply(points)[:, 2])
        scores = np.where(seen, field.sample(joint, np.where(seen[:, None], pixels, 0.0)), 0.0)
        total += scores
        seeing += seen
        support += scores > view_threshold
    return total / np.maximum(seeing, 1), support
