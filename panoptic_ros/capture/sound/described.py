"""Opening a source of sound from a plain description, as it stands in a run's plan."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import takewhile
from pathlib import Path
from typing import Any

from panoptic_ros.capture.sound.microphone import MicrophoneSource
from panoptic_ros.capture.sound.played import PlayedSource
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
