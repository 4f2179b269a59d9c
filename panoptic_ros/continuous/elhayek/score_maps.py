"""Similarity of joints to score maps, each map at its own timestamp.

A score map counts as an image of equation 1 of the paper. Its cells are the image blobs, and their score is
the similarity to the model blob of their joint. So a joint gets the smoothed score at its projection. Maps
are not assigned to people: a map shows the joints of all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from panoptic_ros.continuous.elhayek.blob_similarity import (
    NEAR,
    SIGMAS,
    BlobPairs,
    BlobSimilarity,
    PlaneBlobs,
    ViewedPoints,
    similarity,
)
from panoptic_ros.continuous.elhayek.energy import PoseSums, PoseTerm
from panoptic_ros.continuous.elhayek.skeleton import HingeSkeleton
from panoptic_ros.domain import ScoreMaps
from panoptic_ros.domain.rig_arrays import RigArrays

Array = np.ndarray
# Standard deviations, in cells, of the Gaussian that smooths a map. The first one covers the error of an
# extrapolation: without it, runners are lost. With 4, people who pass disturb each other more.
WIDTHS = (2.0, 1.0)
LEAST_LEFT = 0.1  # minimum share of the equations that no coefficient spends


class TimedMaps(NamedTuple):
    """Cells of the score maps of one view that have a score, its time (s) and its camera.

    Args:
        means: (I, 2) on the normalised image plane, without distortion.
        joints: (I,) index of the detector's joint.
        scores: (I,) 0..1.
        side: of a cell, on that plane.
    """

    time: float
    camera: int
    means: Array
    joints: Array
    scores: Array
    side: float


def timed_maps(time: float, camera: int, maps: ScoreMaps, joints: int, arrays: RigArrays) -> TimedMaps:
    """Return the cells of score maps.

    Args:
        time: s.
        camera: index of the camera.
        joints: number of joints of the detector.
    """
    levels = maps.dense(joints)
    owners, rows, columns = np.nonzero(levels)
    turn, shift = maps.grid_from_image[:, :2], maps.grid_from_image[:, 2]
    pixels = np.linalg.solve(turn, (np.stack([columns, rows]) - shift[:, None])).T
    means = arrays.cameras[camera].intrinsics.undistort(pixels)
    known = np.isfinite(means).all(axis=1)
    side = 1.0 / (np.sqrt(abs(np.linalg.det(turn))) * arrays.focals[camera])
    scores = levels[owners, rows, columns][known].astype(np.float32) / 255.0
    return TimedMaps(
        time, camera, means[known].astype(np.float32), owners[known].astype(np.int16), scores, float(side)
    )


class ScoreMapTerm:
    """Negative share of the scores near a person that its joints reach (a `PoseTerm`).

    Args:
        views: of one segment, at least one, ordered by time.
        poses: (T, D) approximate poses at their times.
        width: standard deviation of the Gaussian that smooths a map, in cells.
    """

    def __init__(
        self,
        views: Sequence[TimedMaps],
        poses: Array,
        width: float,
        skeleton: HingeSkeleton,
        arrays: RigArrays,
    ):
        seen = skeleton.seen
        self.times = np.array([view.time for view in views])
        cameras = np.array([view.camera for view in views])
        self._points = ViewedPoints(
            skeleton, skeleton.site_segments[seen], skeleton.site_offsets[seen], cameras, arrays
        )
        # image and model blobs have the same variance, half of that of the Gaussian between them
        sigmas = np.sqrt(0.5) * width * np.array([view.side for view in views])
        self._sigmas = np.repeat(sigmas, len(seen))
        sites = np.full(len(skeleton.site_segments), -1)
        sites[seen] = np.arange(len(seen))
        means, depths = (values.reshape(len(self._sigmas), -1) for values in self._points.at(poses))
        counts = [len(view.joints) for view in views]
        joints = sites[np.concatenate([view.joints for view in views])]
        model = np.repeat(np.arange(len(views)) * len(seen), counts) + joints
        cells = np.concatenate([view.means for view in views]).astype(np.float64)
        scores = np.concatenate([view.scores for view in views]).astype(np.float64)
        gaps = np.linalg.norm(cells - means[model], axis=1)
        reach = NEAR / depths[:, 0] + SIGMAS * np.sqrt(2.0) * self._sigmas
        near = (joints >= 0) & (gaps < reach[model])
        own = self._sigmas[model[near]]
        self._blobs = PlaneBlobs(cells[near], own)
        self._pairs = BlobPairs(np.arange(len(own)), model[near], scores[near])
        self._weights = 1.0 / (np.pi * own**2 * scores[near].sum())

    @property
    def cells(self) -> int:
        """Return the number of cells near the person."""
        return len(self._weights)

    def sums(self, freedoms: Array) -> PoseSums:
        """Return the energy of degrees of freedom (T, D)."""
        means, _, of_means, _ = self._points.moved(freedoms)
        return self._similarity(means).sums(of_means)

    def precision(self, freedoms: Array, spent: int) -> float:
        """Return the factor from the matrices of `sums` to the information of the score maps.

        The forces that remain on the joints at the minimum state the noise of the maps.
        """
        found = self._similarity(self._points.at(freedoms)[0])
        equations = 2.0 * np.count_nonzero(found.curvatures)
        left = max(equations - spent, LEAST_LEFT * equations) / equations
        bends = float(found.bends.sum())
        noise = float((found.by_means**2).sum()) / (left * bends)
        return bends / (2.0 * float(found.curvatures.sum()) * noise)

    def _similarity(self, means: Array) -> BlobSimilarity:
        """Return the similarity of joints (T, N, 2) on the image planes."""
        return similarity(self._blobs, self._weights, means.reshape(-1, 2), self._sigmas, self._pairs)


class ScoreMapMeasurements:
    """Score maps as `tracking.Measurements`: less smoothed in each fit of a segment.

    Args:
        views: of the whole recording, ordered by time.
    """

    fits = len(WIDTHS)

    def __init__(self, views: Sequence[TimedMaps], skeleton: HingeSkeleton, arrays: RigArrays):
        self._views, self._skeleton, self._arrays = views, skeleton, arrays
        self._times = np.array([view.time for view in views])

    def term(self, fit: int, segment: Array, poses: Callable[[Array], Array]) -> PoseTerm | None:
        """Return the term of a fit of a segment (2,) s, None = no score lies near the person."""
        own = slice(*np.searchsorted(self._times, segment))
        if not self._views[own]:
            return None
        start = poses(self._times[own])
        term = ScoreMapTerm(self._views[own], start, WIDTHS[fit], self._skeleton, self._arrays)
        return term if term.cells else None
