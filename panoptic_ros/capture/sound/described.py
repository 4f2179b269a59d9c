"""Opening a source of sound from a plain description, as it stands in a run's plan."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from panoptic_ros.capture.sound.source import SoundSource
from panoptic_ros.capture.sound.wav import WavSource
from panoptic_ros.errors import UsageError


def described_sound(kind: str, device: str, clocks: Sequence[str], **more: Any) -> dict[str, Any]:
    """A description for `open_sound`, of plain values."""
    return {"kind": kind, "device": device, "clocks": list(clocks), **more}


def open_sound(description: Mapping[str, Any]) -> SoundSource:
    """The source of a description: {"kind": "wav", "device", "clocks", and what opening takes}.

    Raises:
        UserError: as the sources.
    """
    given = {key: value for key, value in description.items() if key != "kind"}
    if description["kind"] == "wav":
        return WavSource(**{**given, "path": Path(given["path"])})
    raise UsageError(f"sound of {given['device']}: there is no source of kind {description['kind']!r}")
