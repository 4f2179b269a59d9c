"""The user bits of a signal, once they are certain."""

from __future__ import annotations

import numpy as np

from panoptic_ros.timecode.word.layout import USER_WEIGHTS

Array = np.ndarray
CERTAIN = 12.0  # nats for every bit
OTHER_NATS = 15.0  # by which a clear word must contradict what was certain
MANY_NATS = 90.0  # by which any word must: several bits; a click turns one or two


class UserBits:
    """User bits by all words of a signal. What was certain stays until words clearly say something else.

    Args:
        soft: (32,) nats for ones from words that were judged together.
    """

    def __init__(self, soft: Array):
        self._nats = soft.astype(np.float64)
        self.certain = bool(np.abs(soft).min() > CERTAIN)
        self._believe((soft > 0.0).astype(np.int8))
        self._other = -1  # what the last clear word said instead

    @property
    def likely(self) -> Array:
        """(32,) the most likely bits."""
        return self._bits

    @property
    def value(self) -> int:
        """The last bits that were certain; 0 before."""
        return self._value if self.certain else 0

    def hear(self, soft: Array, contradiction: float, clear: bool) -> None:
        """Learn from a good word.

        Args:
            soft: (32,) nats for ones.
            contradiction: nats by which it fits better without the likely bits.
            clear: whether no click or noise spoils it.
        """
        heard = (soft > 0.0).astype(np.int8)
        if not self.certain:
            self._nats += soft
            self._believe((self._nats > 0.0).astype(np.int8))
            self.certain = bool(np.abs(self._nats).min() > CERTAIN)
        elif contradiction > (OTHER_NATS if clear else MANY_NATS):
            other = _number(heard)
            if contradiction > MANY_NATS or other == self._other:
                self._believe(heard)
            self._other = other
        else:
            self._other = -1

    def _believe(self, bits: Array) -> None:
        self._bits, self._value = bits, _number(bits)


def _number(bits: Array) -> int:
    return int(USER_WEIGHTS @ bits)
