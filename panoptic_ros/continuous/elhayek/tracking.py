"""Fit of the segments of one person, one after another (paper, 4.4)."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from panoptic_ros.continuous.elhayek.energy import PoseTerm, SegmentEnergy, minimise
from panoptic_ros.continuous.elhayek.polynomials import DEGREE, MotionFunction, extrapolated
from panoptic_ros.continuous.elhayek.skeleton import Skeleton

Array = np.ndarray
# From the first and last instant (s) of a segment to its terms, once per fit: later fits start from earlier ones.
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
    previous one, and keeps it where no measurement lies in the segment.

    Args:
        segments: (G, 2) s.
        pose: (D,) known pose in the first segment.
        progress: is told the share that is done.
    """
    coefficients = np.zeros((len(segments), skeleton.freedoms, DEGREE + 1))
    covariances = []
    for g, segment in enumerate(segments):
        progress(g / len(segments))
        if g == 0:
            coefficients[0, :, 0] = pose
        else:
            coefficients[g] = extrapolated(coefficients[g - 1], segments[g - 1], segment)
        start = coefficients[g].copy()
        energy = SegmentEnergy(segment, (), skeleton.limits, start)
        for terms in terms_of(*segment):
            energy = SegmentEnergy(segment, terms, skeleton.limits, start)
            coefficients[g] = minimise(energy, coefficients[g], DEGREE + 1 if g else 1)
        covariances.append(energy.covariance(coefficients[g]))
    return MotionFunction(segments, coefficients), np.stack(covariances)
