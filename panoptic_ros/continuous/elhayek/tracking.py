"""Fit of the segments of one person, one after another (paper, 4.4)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from panoptic_ros.continuous.elhayek.energy import PoseTerm, SegmentEnergy, minimise
from panoptic_ros.continuous.elhayek.polynomials import (
    DEGREE,
    MotionFunction,
    basis,
    extrapolated,
    held,
    place,
)
from panoptic_ros.continuous.elhayek.skeleton import Skeleton

Array = np.ndarray


class Measurements(Protocol):
    """Measurements of one person over a recording.

    Args:
        fits: number of fits of a segment, each from the result of the previous one.
    """

    fits: int

    def term(self, fit: int, segment: Array, start: Callable[[Array], Array]) -> PoseTerm | None:
        """Return the term of a fit of a segment (2,) s, None = no measurement lies in it.

        Args:
            start: gives degrees of freedom (T, D) at times (T,) s, from which the fit starts.
        """
        ...


def track(
    skeleton: Skeleton,
    segments: Array,
    pose: Array,
    measured: Sequence[Measurements],
    degree: int = DEGREE,
    progress: Callable[[float], None] = lambda share: None,
) -> tuple[MotionFunction, Array]:
    """Return the motion function of a person, and the covariances (G, D L, D L) of its coefficients.

    The first segment has a constant pose. Each following one starts from the linear extrapolation of the
    previous one, and keeps it where no measurement lies in the segment. The slope of a short segment with few
    views is mostly noise: if the pose held has less energy, it is the start.

    Args:
        segments: (G, 2) s.
        pose: (D,) known pose in the first segment.
        degree: of the polynomials.
        progress: is told the share that is done.
    """
    coefficients = np.zeros((len(segments), skeleton.freedoms, degree + 1))
    covariances = []
    for g, segment in enumerate(segments):
        progress(g / len(segments))
        starts = [np.column_stack([pose, np.zeros((len(pose), degree))])]
        if g:
            starts = [f(coefficients[g - 1], segments[g - 1], segment) for f in (extrapolated, held)]
        coefficients[g], covariance = _fit(skeleton, segment, starts, measured, degree + 1 if g else 1)
        covariances.append(covariance)
    return MotionFunction(segments, coefficients), np.stack(covariances)


def _fit(
    skeleton: Skeleton, segment: Array, starts: Sequence[Array], measured: Sequence[Measurements], order: int
) -> tuple[Array, Array]:
    """Return the coefficients (D, L) of a segment and their covariance (D L, D L).

    Args:
        starts: (D, L) each; the first fit starts from that of least energy.
        order: see `minimise`.
    """
    found = starts[0]
    for k in range(max(one.fits for one in measured)):

        def poses(times: Array) -> Array:
            return basis(place(times, *segment), found.shape[1]) @ found.T

        terms = [one.term(min(k, one.fits - 1), segment, poses) for one in measured]
        energy = SegmentEnergy(segment, [t for t in terms if t is not None], skeleton.limits, starts[0])
        if k == 0:
            found = min(starts, key=lambda start: energy.sums(start).energy)
        found = minimise(energy, found, order)
    return found, energy.covariance(found)
