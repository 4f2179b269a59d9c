"""Interface of all audio sources."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol, runtime_checkable

from panoptic_ros.domain import AudioBlock

BLOCK_S = 0.1  # s, the longest block


@runtime_checkable
class SoundSource(Protocol):
    """Audio of one device, in order; a context manager that closes the source.

    Every iteration of a recorded source starts at its first sample. A live source never ends.
    """

    device: str
    clocks: tuple[str, ...]  # clock whose timecode each channel carries, "" = none; (): not stated

    def __iter__(self) -> Iterator[AudioBlock]: ...

    def close(self) -> None:
        """Release files and devices; may be called twice."""

    def __enter__(self) -> SoundSource: ...

    def __exit__(self, *exception: object) -> None: ...
