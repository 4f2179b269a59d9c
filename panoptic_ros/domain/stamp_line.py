"""A line that corrects the stamps of a camera."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from panoptic_ros.errors import DataError, shown


@dataclass(frozen=True, slots=True)
class StampLine:
    """What is added to stamps: offset_ns + drift (stamp - reference_ns).

    Args:
        drift: dimensionless, 1e-6 = 1 ppm.
    """

    reference_ns: int
    offset_ns: int
    drift: float = 0.0

    @classmethod
    def from_words(cls, words: Mapping[str, Any]) -> StampLine:
        """The line of plain words, as `words` gives them.

        Raises:
            DataError: if these are no such numbers.
        """
        try:
            return cls(int(words["reference_ns"]), int(words["offset_ns"]), float(words["drift"]))
        except (KeyError, TypeError, ValueError):
            raise DataError(f"{shown(words)} is no correction of stamps") from None

    def words(self) -> dict[str, Any]:
        """Plain words that a file can hold."""
        return asdict(self)

    def corrected(self, stamp_ns: int) -> int:
        """The corrected stamp, ns; it may lie before 0."""
        return stamp_ns + self.offset_ns + round(self.drift * (stamp_ns - self.reference_ns))
