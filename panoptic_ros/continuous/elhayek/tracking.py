"""Fit of the segments of one person, one after another (paper, 4.4)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from panoptic_ros.continuous.elhayek.energy import VAGUE, PoseTerm, SegmentEnergy, minimise
from panoptic_ros.continuous.elhayek.polynomials import MotionFunction, basis, extrapolated
from panoptic_ros.continuous.elhayek.skeleton import HingeSkeleton

Array = np.ndarray


class Measurements(Protocol):
    """Measurements of one person over a recording.

    Args:
        fits: number of fits of a segment, each from the result of the previous one.
    """

    fits: int

    def term(self, fit: int, segment: Array, poses: Callable[[Array], Array]) -> PoseTerm | None:
        """Return the term of a fit of a segment (2,) s, None = no measurement lies in it.

        Args:
            poses: gives degrees of freedom (T, D) at times (T,) s, from which the fit starts.
        """
        ...


def track(
    skeleton: HingeSkeleton,
    segments: Array,
    known: Callable[[float], Array],
    measured: Measurements,
    degree: int,
    progress: Callable[[float], None],
) -> tuple[MotionFunction, Array]:
    """Return the motion function of a person, and the covariances (G, D, L, D, L) of its coefficients.

    The first segment has a constant pose, near a known one. Each following one starts from the linear
    extrapolation of the previous one. A segment without measurement has a known pose, and so has the start of
    the next one.

    Args:
        segments: (G, 2) s.
        known: gives a known pose (D,) near a time (s).
        degree: of the polynomials.
        progress: receives the share of segments that are fitted.
    """
    shape = (skeleton.freedoms, degree + 1)
    coefficients = np.zeros((len(segments), *shape))
    covariances = np.zeros((len(segments), *shape, *shape))
    followed = False
    for g, segment in enumerate(segments):
        progress(g / len(segments))
        if followed:
            start = extrapolated(coefficients[g - 1], segments[g - 1], segment)
        else:
            start = np.zeros(shape)
            start[:, 0] = known(float(segment.mean()))
        found, followed = start, False
        for fit in range(measured.fits):

            def poses(times: Array, found: Array = found, segment: Array = segment) -> Array:
                values: Array = basis(times, segment, degree + 1) @ found.T
                return values

            term = measured.term(fit, segment, poses)
            if term is not None:
                energy, followed = SegmentEnergy(segment, term, skeleton.limits, start), True
                found = minimise(energy, found, degree + 1 if g else 1)
        coefficients[g] = found
        covariances[g] = (
            energy.covariance(found)
            if followed
            else (np.eye(start.size) / VAGUE).reshape(covariances[g].shape)
        )
    return MotionFunction(segments, coefficients), covariances
