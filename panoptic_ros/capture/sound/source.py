"""What every source of sound offers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol, runtime_checkable

from panoptic_ros.domain import AudioBlock

BLOCK_S = 0.1  # the longest block


@runtime_checkable
class SoundSource(Protocol):
    """The sound of one device, in order; a context manager that closes itself.

    Iterating a recorded source starts at its first sample every time; a live one goes on for ever.
    """

    device: str
    clocks: tuple[str, ...]  # whose timecode the channels carry, "" = none; empty: nobody says

    def __iter__(self) -> Iterator[AudioBlock]: ...

    def close(self) -> None:
        """Give up files and devices; may be called twice."""

    def __enter__(self) -> SoundSource: ...

    def __exit__(self, *exception: object) -> None: ...
