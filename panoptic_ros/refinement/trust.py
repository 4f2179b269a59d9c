"""Restart of joints whose filter began at a wrong position.

Where the surface shows the motion of a joint, the filter propagates a wrong position as confidently as a
right one. The measurements of views then remain outliers.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray
BEGUN = 0.1  # s, trust in a joint whose filter has just begun
TRUSTED = 1.0  # s, upper limit of the trust


def given_up(trust: Array, innovations: Array, linked: Array, dt: float, cauchy: float) -> Array:
    """Return a mask (P, J) of joints that measurements have contradicted for longer than they agreed.

    Only joints with displacements measured on the surface can be contradicted.

    Args:
        trust: (P, J) s, time of agreement minus time of contradiction; updated in place, at most `TRUSTED`.
        innovations: (P, J, 3) whitened, NaN = not measured.
        linked: (P, J) whether the displacement of the joint was measured on the surface.
        dt: Time since the previous moment, s.
        cauchy: RMS innovation beyond which a measurement contradicts, in standard deviations.
    """
    squares = np.mean(innovations**2, axis=2)
    wrong = (squares > cauchy**2) & linked
    trust[...] = np.minimum(trust + dt * np.where(wrong, -1.0, np.isfinite(squares)), TRUSTED)
    found: Array = wrong & (trust < 0.0)
    trust[found] = BEGUN
    return found
