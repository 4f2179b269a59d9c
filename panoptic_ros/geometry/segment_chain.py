"""A chain of segments as data, which needs no compiled code."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

Array = np.ndarray


class Chain(NamedTuple):
    """What compiled code needs of a body: parents (S,), -1 = root, each before its children; offsets (S,
    3) m."""

    parents: Array
    offsets: Array
