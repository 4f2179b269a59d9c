"""Lengths that were learnt anew come in bit by bit: limbs that changed at once would jump."""

from __future__ import annotations

import math

import numpy as np

from panoptic_ros.domain.segments import Body

Array = np.ndarray
LASTS_S = 0.5


class Lengthening:
    """From one set of offsets to those of a body, along half a cosine.

    Args:
        begin: (S, 3) m, offsets now.
    """

    def __init__(self, begin: Array, body: Body):
        self._begin, self._body, self._passed_s = begin.copy(), body, 0.0

    @property
    def is_over(self) -> bool:
        """Whether the body has its lengths."""
        return self._passed_s >= LASTS_S

    def after(self, seconds: float) -> Body:
        """The body so many seconds later than it was last asked for."""
        self._passed_s += seconds
        if self.is_over:
            return self._body
        share = 0.5 - 0.5 * math.cos(math.pi * self._passed_s / LASTS_S)
        offsets = self._begin + share * (self._body.offsets - self._begin)
        return self._body.with_offsets(dict(zip(self._body.model.names, offsets)))
