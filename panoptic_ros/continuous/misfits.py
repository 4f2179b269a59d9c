"""Misfits of a body model: local variances of what its bones and degrees of freedom cannot follow."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter1d

from panoptic_ros.continuous.person import PersonCurve

Array = np.ndarray
SMOOTHING_S = 0.1  # s, standard deviation of the weights of the average; with 0.3 s, fast moments lose
# share of the expected square that is subtracted, as covariances of curves are stated a little large. With 1,
# 95 % ellipsoids hold .89 to .92 (`faster`, `free`, --subject) and .975 (preset, `crossing`); with this, .915
# to .921 and .983; with 0.5, .937 to .957 and .989
SHARE = 0.75


def local_misfits(
    person: PersonCurve, times: Array, joints: Array, positions: Array, covariances: Array
) -> Array:
    """Return the variances (T, S) m^2 per axis by which a body model misses the curves of the joints.

    Without misfit, the covariance of the difference is the difference of the covariances, as one of the two
    estimates is efficient (Hausman 1978). The remainder of the squared difference is averaged over time.

    Args:
        person: Curves that were fitted joint by joint.
        times: (T,) s, evenly spaced.
        joints: (S,) indices of the joints, or (J,) a mask.
        positions: (T, S, 3) m of the body model.
        covariances: (T, S, 3, 3) m^2 of these positions.
    """
    squares = ((positions - person.at(times)[:, joints]) ** 2).sum(axis=-1)
    own, theirs = (
        np.trace(values, axis1=-2, axis2=-1)
        for values in (person.covariances_at(times)[:, joints], covariances)
    )
    beyond = np.nan_to_num(squares - SHARE * np.abs(own - theirs))
    smooth = gaussian_filter1d(beyond, SMOOTHING_S / (times[1] - times[0]), axis=0)
    misfits: Array = np.maximum(smooth, 0.0) / 3.0
    return misfits
