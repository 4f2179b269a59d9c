"""Chain of segments as data, in a module without compiled code."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

Array = np.ndarray


class Chain(NamedTuple):
    """Chain of S segments as compiled code takes it.

    Args:
        parents: (S,), -1 = root; each parent comes before its children.
        offsets: (S, 3) m, joints in the frames of their parents.
    """

    parents: Array
    offsets: Array
