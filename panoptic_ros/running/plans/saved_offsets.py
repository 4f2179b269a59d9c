"""Reads saved clock offsets of cameras for a given rig."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from panoptic_ros.errors import UsageError
from panoptic_ros.io.clock_offsets import SavedOffset, read_offsets


def saved_offsets(path: Path, cameras: Sequence[str]) -> dict[str, SavedOffset]:
    """Return the saved offsets of these cameras.

    Raises:
        UsageError: if the file corrects none of them.
        DataError: if it cannot be read.
    """
    saved = {name: offset for name, offset in read_offsets(path).items() if name in cameras}
    if not saved:
        raise UsageError(f"{path} corrects none of the cameras {', '.join(cameras)}; leave --offsets out")
    return saved


def saved_lines(saved: Mapping[str, SavedOffset], cameras: Sequence[str]) -> list[str]:
    """Return lines that state the applied offsets."""
    width = max(len(name) for name in cameras)
    lines = ["offsets as saved (added to the stamps, without drifts):"]
    for name in cameras:
        text = "stamps kept"
        if name in saved:
            text = f"{1e3 * saved[name].offset_s:+8.2f} ms"
            text += f" +- {1e3 * saved[name].offset_std_s:.2f}" if saved[name].offset_std_s else ""
        lines.append(f"  {name:<{width}}  {text}")
    lines += [
        (
            f"  the clock of {name} drifts by {60e3 * saved[name].drift:+.1f} ms a minute: its offset "
            "changes, estimate it again"
        )
        for name in cameras
        if name in saved and saved[name].drifts
    ]
    return lines
