"""A person of the dynamic program before the final solve, with the 2D joints it claims."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """One person before the final solve.

    Args:
        start: (J, 3) m, a first position of each joint, NaN where there is none.
        claims: (J, V) index of the 2D person in each of the set's V views whose joint this is, -1 = none.
            No 2D joint is claimed by two hypotheses (Joo et al. 2017, 5.3).
        claimed_joints: (J, V) which joint of that 2D person is meant: the same joint, or the one on the
            other side where the detector exchanged left and right.
        score: in 0..1, for the order of people.
    """

    start: Array
    claims: Array
    claimed_joints: Array
    score: float
