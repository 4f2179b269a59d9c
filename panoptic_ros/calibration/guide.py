"""Guide of a live calibration: what each camera has seen of the board, and the most useful next step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from panoptic_ros.calibration.lens_start import lens_prior
from panoptic_ros.calibration.quality import (
    CELLS,
    GOOD_CENTRE_PX,
    GOOD_COVERAGE,
    GOOD_ERROR_M,
    GOOD_FOCAL,
    GOOD_NOISE_PX,
    GOOD_TILT_DEG,
    GOOD_VIEWS,
    CameraQuality,
    Quality,
    covered_cells,
    refusals,
)
from panoptic_ros.calibration.rig_start import FEWEST_VIEWS, CameraInput
from panoptic_ros.calibration.target_poses import intrinsics_of, poses_of
from panoptic_ros.calibration.target_views import TargetView

Array = np.ndarray
# mean motion of the corners over their extent in the image, below which a view repeats the last one. With
# less motion per `LONGEST_STEP_S`, a board of 400 px moves by 0.3 px in the 10 ms by which cameras differ.
MOVED = 0.03
TOGETHER_S = 0.1  # s, longest time between two views that link their cameras: half the period of the search
FEWEST_LINKS = 3  # instants that link two cameras: fewer have no majority for the medoid of relative poses
FIRST_FOCAL = 0.8  # focal length over the longer side of the image, until the first solution
NOT_SEEN, SOLVING = "no board was seen yet", "the first views are being solved"
MOST_STEPS = 2  # steps in one line of advice
SIDES = {
    "left edge": np.s_[:, 0],
    "right edge": np.s_[:, -1],
    "upper edge": np.s_[0, :],
    "lower edge": np.s_[-1, :],
    "middle": np.s_[1:-1, 1:-1],
}


class CameraGuide(NamedTuple):
    """Guide of one camera.

    Args:
        name: Its name.
        views: Number of views.
        covered: (rows, columns) whether the cells of the image hold corners.
        tilted: Number of views with a tilt of at least the first of `GOOD_TILT_DEG`.
        distances: (nearest, farthest) m of the board; None before the first view.
        linked: Whether instants link it to most other cameras.
        advice: Next steps; "" = this camera has seen enough.
    """

    name: str
    views: int
    covered: Array
    tilted: int
    distances: tuple[float, float] | None
    linked: bool
    advice: str


class GuideState(NamedTuple):
    """State of the guide.

    Args:
        cameras: One per camera.
        links: Number of common instants by pair of cameras.
        error_m: Predicted error, m, in the space of the board; None = not solvable.
        unsolved: Reason without a predicted error.
        advice: Next step for all cameras; "" = see the cameras.
        usable: Whether the recording gives a calibration that is not refused.
        enough: Whether the recording gives a good calibration.
    """

    cameras: tuple[CameraGuide, ...]
    links: Mapping[tuple[int, int], int]
    error_m: float | None
    unsolved: str
    advice: str
    usable: bool
    enough: bool


class CalibrationGuide:
    """Guide of a live calibration, by the limits of `quality.doubts`. Clocks need no advice.

    Args:
        cameras: All cameras.
        points: (N, 3) m, points of the board.
    """

    def __init__(self, cameras: Sequence[CameraInput], points: Array):
        self._cameras, self._points = tuple(cameras), points
        self._lenses = [
            camera.known[0]
            if camera.known is not None
            else lens_prior(camera.size, FIRST_FOCAL * max(camera.size), camera.model)[0]
            for camera in cameras
        ]
        self._views: list[TargetView] = []
        self._last: dict[int, TargetView] = {}
        self._covered = np.zeros((len(cameras), *CELLS[::-1]), bool)
        self._tilts: list[float] = []  # degrees, by view
        self._distances: list[float] = []  # m, by view
        self._links: dict[tuple[int, int], int] = {(a, b): 0 for b in range(len(cameras)) for a in range(b)}
        self._quality: Quality | None = None
        self._unsolved = NOT_SEEN

    @property
    def views(self) -> tuple[TargetView, ...]:
        """Return all views that were added."""
        return tuple(self._views)

    def add(self, seen: Sequence[TargetView]) -> bool:
        """Add the views of all cameras at one time, unless none of them shows a moved board.

        Returns:
            whether they were added.
        """
        if not any(self._has_moved(view) for view in seen):
            return False
        if not self._views:
            self._unsolved = SOLVING
        self._views += seen
        for view in seen:
            self._last[view.camera] = view
            self._covered[view.camera] |= covered_cells(view.pixels, self._cameras[view.camera].size)
            for other in seen:
                if view.camera < other.camera and abs(view.stamp_s - other.stamp_s) <= TOGETHER_S:
                    self._links[view.camera, other.camera] += 1
        self._measure(seen)
        return True

    def solved(self, quality: Quality, lenses: Array) -> None:
        """Take the result of a calibration of the views so far.

        Args:
            lenses: (C, 12), see `CameraStates`.
        """
        self._quality, self._unsolved = quality, ""
        self._lenses = list(lenses)
        self._tilts, self._distances = [], []
        self._measure(self._views)

    def not_solved(self, reason: str) -> None:
        """Take the reason for which the views so far give no calibration."""
        self._quality, self._unsolved = None, reason

    def state(self) -> GuideState:
        """Return the state."""
        linked = self._linked()
        cameras = tuple(self._guide(c, linked) for c in range(len(self._cameras)))
        busy = any(camera.advice for camera in cameras)
        error = None if self._quality is None else self._quality.error_m
        precise = error is not None and error <= GOOD_ERROR_M
        return GuideState(
            cameras,
            dict(self._links),
            error,
            self._unsolved,
            "" if busy or precise or error is None else "show the board in more places, near each camera too",
            self._quality is not None and not refusals(self._quality),
            precise and not busy,
        )

    def _has_moved(self, view: TargetView) -> bool:
        last = self._last.get(view.camera)
        if last is None:
            return True
        _, own, their = np.intersect1d(view.numbers, last.numbers, return_indices=True)
        if not len(own):
            return True
        motion = np.linalg.norm(view.pixels[own] - last.pixels[their], axis=1).mean()
        return bool(motion > MOVED * np.linalg.norm(np.ptp(view.pixels, axis=0)))

    def _measure(self, views: Sequence[TargetView]) -> None:
        """Append the tilts, degrees, and distances, m, of the board in views; NaN without a pose."""
        own = [intrinsics_of(lens, camera.model.fisheye) for lens, camera in zip(self._lenses, self._cameras)]
        for poses in poses_of(views, self._points, own):
            tilt = distance = float("nan")
            if poses:
                distance = float(np.linalg.norm(poses[0].translation))
                facing = abs(poses[0].rotation[:, 2] @ poses[0].translation) / max(distance, 1e-9)
                tilt = float(np.degrees(np.arccos(min(facing, 1.0))))
            self._tilts.append(tilt)
            self._distances.append(distance)

    def _linked(self) -> frozenset[int]:
        """Return the largest group of cameras that are linked; the first of equally large ones."""
        groups: list[set[int]] = [{c} for c in range(len(self._cameras))]
        for (a, b), count in self._links.items():
            if count >= FEWEST_LINKS and groups[a] is not groups[b]:
                groups[a] |= groups[b]
                for c in groups[b]:
                    groups[c] = groups[a]
        sizes = [len(group) for group in groups]
        return frozenset(groups[sizes.index(max(sizes))])

    def _guide(self, number: int, linked: frozenset[int]) -> CameraGuide:
        own = [k for k, view in enumerate(self._views) if view.camera == number]
        tilts, distances = np.array(self._tilts)[own], np.array(self._distances)[own]
        tilted = int((tilts >= GOOD_TILT_DEG[0]).sum())  # False for NaN
        known = distances[np.isfinite(distances)]
        steps = self._steps(number, len(own), tilted, linked)
        return CameraGuide(
            self._cameras[number].name,
            len(own),
            self._covered[number].copy(),
            tilted,
            (float(known.min()), float(known.max())) if len(known) else None,
            number in linked,
            ", ".join(steps[:MOST_STEPS]),
        )

    def _steps(self, number: int, views: int, tilted: int, linked: frozenset[int]) -> list[str]:
        """Return the next steps of a camera, the most useful one first."""
        name = self._cameras[number].name
        if not views:
            return [f"show the board to {name}"]
        steps = []
        if number not in linked:
            steps.append(f"show the board to {self._partner(number, linked)} and {name} at once")
        tilt = f"tilt the board by {GOOD_TILT_DEG[0]} to {GOOD_TILT_DEG[1]} degrees"
        quality = self._quality.cameras[number] if self._quality is not None else None
        if self._cameras[number].known is None and tilted < FEWEST_VIEWS:
            steps.append(tilt)
        elif quality is not None and quality.focal_sd > GOOD_FOCAL:
            steps.append(f"{tilt} near the camera")
        covered = self._covered[number]
        if covered.mean() < GOOD_COVERAGE:
            steps.append(f"cover the {max(SIDES, key=lambda side: 1.0 - covered[SIDES[side]].mean())}")
        if quality is not None:
            steps += _steps_by_quality(quality)
        if views < GOOD_VIEWS:
            steps.append(f"show {GOOD_VIEWS - views} more views")
        return steps

    def _partner(self, number: int, linked: frozenset[int]) -> str:
        """Return the name of the linked camera with most common instants, or the nearest one in the order."""

        def merit(other: int) -> tuple[int, int]:
            return self._links[min(number, other), max(number, other)], -abs(number - other)

        return self._cameras[max(linked, key=merit)].name


def _steps_by_quality(quality: CameraQuality) -> list[str]:
    steps = []
    if quality.centre_sd_px > GOOD_CENTRE_PX:
        steps.append("turn the board about its normal at all edges")
    if quality.noise_px > GOOD_NOISE_PX:
        steps.append("move the board more slowly, check the focus")
    return steps
