"""Opening a source of sound from a plain description, as it stands in a run's plan.

A recording may be played as if a device heard it now: to try a live run without hardware.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import takewhile
from pathlib import Path
from typing import Any

from panoptic_ros.capture.sound.microphone import MicrophoneSource
from panoptic_ros.capture.sound.source import SoundSource
from panoptic_ros.capture.sound.video import VideoSound
from panoptic_ros.capture.sound.wav import WavSource
from panoptic_ros.domain import AudioBlock
from panoptic_ros.errors import UsageError, shown


def described_sound(kind: str, device: str, clocks: Sequence[str], **more: Any) -> dict[str, Any]:
    """A description for `open_sound`, of plain values."""
    return {"kind": kind, "device": device, "clocks": list(clocks), **more}


class _Ended:
    """A source that ends early."""

    def __init__(self, source: SoundSource, until_ns: int):
        self.device, self.clocks = source.device, source.clocks
        self._source, self._until_ns = source, until_ns

    def __iter__(self) -> Iterator[AudioBlock]:
        return takewhile(lambda block: block.stamp_ns < self._until_ns, iter(self._source))

    def close(self) -> None:
        """Close the source."""
        self._source.close()

    def __enter__(self) -> SoundSource:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


def open_sound(description: Mapping[str, Any]) -> SoundSource:
    """The source of a description: {"kind", "device", "clocks", what opening takes}; kinds are wav, video and
    microphone.

    A microphone whose address is that of a WAV file plays it in real time. Blocks of a recording with the
    stamp "until_ns" and later ones are left out.

    Raises:
        UserError: as the sources.
    """
    if "until_ns" in description:
        whole = {key: value for key, value in description.items() if key != "until_ns"}
        return _Ended(open_sound(whole), description["until_ns"])
    given = {key: value for key, value in description.items() if key != "kind"}
    if description["kind"] == "wav":
        return WavSource(**{**given, "path": Path(given["path"])})
    if description["kind"] == "video":
        return VideoSound(**{**given, "path": Path(given["path"])})
    if description["kind"] == "microphone":
        address = str(given.pop("address"))
        if address.lower().endswith(".wav"):
            return PlayedSource(path=Path(address), **given)
        return MicrophoneSource(address=address, **given)
    raise UsageError(f"sound of {given['device']}: there is no source of kind {shown(description['kind'])}")


class PlayedSource:
    """A WAV file in real time, stamped by this machine's clock. It ends with the file.

    Args:
        clocks: of the channels, see `AudioBlock`.
        clock: ns; of the stamps, the wall clock unless given.
        wait: for so many seconds; True if the source was closed meanwhile. For tests.

    Raises:
        DataError: see `WavSource`.
    """

    def __init__(
        self,
        device: str,
        path: Path,
        *,
        clocks: Sequence[str] = (),
        clock: Callable[[], int] = time.time_ns,
        wait: Callable[[float], bool] | None = None,
    ):
        self.device, self.clocks = device, tuple(clocks)
        self._file = WavSource(device, path, clocks=clocks)
        self._closed = threading.Event()
        self._clock, self._wait = clock, wait or self._closed.wait

    def __iter__(self) -> Iterator[AudioBlock]:
        began = self._clock()
        for block in self._file:
            left = began + block.end_ns - self._clock()
            if left > 0 and self._wait(left * 1e-9):
                return
            yield replace(block, stamp_ns=began + block.stamp_ns)

    def close(self) -> None:
        """End iterations that are under way."""
        self._closed.set()

    def __enter__(self) -> PlayedSource:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
