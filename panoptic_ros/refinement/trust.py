"""Joints that were begun at a wrong place, and are given up.

Where the surface shows how a joint moves, that is carried on from a wrong place as surely as from a right
one, and what views measure is an outlier for as long.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray
BEGUN = 0.1  # s, trust in a motion that begins
TRUSTED = 1.0  # s, most that a joint's motion is trusted


def given_up(trust: Array, innovations: Array, linked: Array, dt: float, cauchy: float) -> Array:
    """Which joints (P, J) measurements have contradicted for longer than not.

    Args:
        trust: (P, J) s, for how much longer they have agreed; follows, in place.
        innovations: (P, J, 3) whitened, NaN = not measured. linked: (P, J) whether the surface shows how a
            joint moved in these dt s. cauchy: deviations beyond which a measurement contradicts.
    """
    squares = np.mean(innovations**2, axis=2)
    wrong = (squares > cauchy**2) & linked
    trust[...] = np.minimum(trust + dt * np.where(wrong, -1.0, np.isfinite(squares)), TRUSTED)
    found: Array = wrong & (trust < 0.0)
    trust[found] = BEGUN
    return found
