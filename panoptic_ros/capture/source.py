"""Interface of all frame sources, and the timestamps of recorded ones."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from itertools import pairwise
from typing import Protocol, runtime_checkable

from panoptic_ros.domain import ViewFrame
from panoptic_ros.errors import ConfigError, DataError

SECOND_NS = 1_000_000_000


@runtime_checkable
class FrameSource(Protocol):
    """Frames of one camera, in order; a context manager that closes the source.

    Every iteration of a recorded source starts at its first frame. A live source never ends.
    """

    camera: str
    image_size: tuple[int, int]  # (width, height) px
    frame_rate: float  # Hz, nominal
    frame_count: int | None  # None = unknown

    def __iter__(self) -> Iterator[ViewFrame]: ...

    def close(self) -> None:
        """Release files and devices; may be called twice."""

    def __enter__(self) -> FrameSource: ...

    def __exit__(self, *exception: object) -> None: ...


def exact_rate(frame_rate: float, what: str) -> Fraction:
    """Return the frame rate as a fraction: 29.97002997 is 30000/1001, 29.97 is 2997/100.

    Raises:
        ConfigError: if it is outside of 0.01 to 10000 Hz.
    """
    if not 0.01 <= frame_rate <= 10_000.0:  # also refuses NaN
        raise ConfigError(f"{what}: frame rate {frame_rate} Hz; give one between 0.01 and 10000")
    near = Fraction(frame_rate).limit_denominator(1001)
    return near if abs(float(near) / frame_rate - 1.0) < 1e-8 else Fraction(frame_rate)


def grid_stamp(start_ns: int, index: int, rate: Fraction) -> int:
    """Return start_ns + index / rate in ns, rounded once, so that errors do not accumulate."""
    return start_ns + round(index * SECOND_NS / rate)


def check_stamps(stamps: Sequence[int], what: str) -> tuple[int, ...]:
    """Return the timestamps of recorded frames after checking that they increase.

    Raises:
        DataError: naming the first frame whose timestamp does not increase.
    """
    for i, (before, after) in enumerate(pairwise(stamps), start=1):
        if after <= before:
            raise DataError(f"{what}: the stamp of frame {i} ({after} ns) is not after the previous one")
    return tuple(int(stamp) for stamp in stamps)
