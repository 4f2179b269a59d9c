"""Fit of the segments of one person, one after another (paper, 4.4)."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from panoptic_ros.continuous.elhayek.energy import PoseTerm, SegmentEnergy, minimise
from panoptic_ros.continuous.elhayek.polynomials import DEGREE, MotionFunction, extrapolated, held
from panoptic_ros.continuous.elhayek.skeleton import Skeleton

Array = np.ndarray
# From the first and last instant (s) of a segment to its terms, one entry per fit: each fit starts from the
# previous one.
TermsOf = Callable[[float, float], Sequence[Sequence[PoseTerm]]]


def track(
    skeleton: Skeleton,
    segments: Array,
    pose: Array,
    terms_of: TermsOf,
    progress: Callable[[float], None] = lambda share: None,
) -> tuple[MotionFunction, Array]:
    """Return the motion function of a person, and the covariances (G, D L, D L) of its coefficients.

    The first segment has a constant pose. Each following one starts from the linear extrapolation of the
    previous one, and keeps it where no measurement lies in the segment. The slope of a short segment with few
    views is mostly noise: if the pose held has less energy, it is the start.

    Args:
        segments: (G, 2) s.
        pose: (D,) known pose in the first segment.
        progress: is told the share that is done.
    """
    coefficients = np.zeros((len(segments), skeleton.freedoms, DEGREE + 1))
    covariances = []
    for g, segment in enumerate(segments):
        progress(g / len(segments))
        fits = list(terms_of(*segment)) or [()]
        starts = [np.column_stack([pose, np.zeros((len(pose), DEGREE))])]
        if g:
            starts = [f(coefficients[g - 1], segments[g - 1], segment) for f in (extrapolated, held)]
        energies = [SegmentEnergy(segment, fits[0], skeleton.limits, one).sums(one).energy for one in starts]
        start = starts[int(np.argmin(energies))]
        found = start
        for terms in fits:
            energy = SegmentEnergy(segment, terms, skeleton.limits, start)
            found = minimise(energy, found, DEGREE + 1 if g else 1)
        coefficients[g] = found
        covariances.append(energy.covariance(found))
    return MotionFunction(segments, coefficients), np.stack(covariances)
