"""Reads saved clocks and line delays of cameras for a given rig and recording."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from panoptic_ros.domain import DetectionSet, Rig, StampLine
from panoptic_ros.errors import UsageError
from panoptic_ros.io.clock_files import SavedClock, read_clocks

NEAR_NS = 1_000_000_000  # ns by which a reference may lie outside of a recording, because clocks differ


def saved_clocks(path: Path, cameras: Sequence[str]) -> dict[str, SavedClock]:
    """Return the saved clocks of these cameras.

    Raises:
        UsageError: if the file corrects none of them.
        DataError: if it cannot be read.
    """
    saved = {name: clock for name, clock in read_clocks(path).items() if name in cameras}
    if not saved:
        raise UsageError(f"{path} corrects none of the cameras {', '.join(cameras)}; leave --offsets out")
    return saved


def with_line_delays(rig: Rig, saved: Mapping[str, SavedClock]) -> Rig:
    """Return the rig with the saved line delays, which replace its own; negative ones are noise about 0."""
    delays = {name: clock.line_delay_us for name, clock in saved.items() if clock.line_delay_us is not None}
    if not delays:
        return rig
    cameras = (
        replace(camera, line_delay_us=max(0.0, delays.get(camera.name, camera.line_delay_us)))
        for camera in rig.cameras
    )
    return replace(rig, cameras=tuple(cameras))


@dataclass(frozen=True)
class RecordingClocks:
    """Saved clocks for the timestamps of one recording.

    Drifts count if the recording contains the reference of the clocks, so that they were estimated in it.
    Elsewhere the reference is too far away.

    Args:
        saved: clocks by camera.
        lines: corrections of the timestamps by camera.
        drifting: whether drifts count.
    """

    saved: Mapping[str, SavedClock]
    lines: Mapping[str, StampLine]
    drifting: bool

    @classmethod
    def of(cls, path: Path, cameras: Sequence[str], sets: Iterable[DetectionSet]) -> RecordingClocks:
        """Return the clocks of a file for a recording.

        Raises:
            UserError: see `saved_clocks`.
        """
        saved = saved_clocks(path, cameras)
        stamps: dict[str, list[int]] = {}
        for item in sets:
            for view in item.views:
                stamps.setdefault(view.camera, []).append(view.stamp_ns)
        spans = [(min(own), max(own)) for own in stamps.values()]
        references = {clock.reference_ns for clock in saved.values()}
        drifting = any(
            at is None or any(a - NEAR_NS <= at <= b + NEAR_NS for a, b in spans) for at in references
        )
        first = min((begin for begin, _ in spans), default=0)
        return cls(saved, {name: clock.line(first, drifting) for name, clock in saved.items()}, drifting)

    def corrected(self, camera: str, stamp_ns: int) -> int:
        """Return a corrected timestamp, ns; it may be negative."""
        line = self.lines.get(camera)
        return stamp_ns if line is None else line.corrected(stamp_ns)

    def told(self, cameras: Sequence[str]) -> list[str]:
        """Return lines that state the applied clocks."""
        return saved_lines(self.saved, cameras, self.drifting)


def saved_lines(saved: Mapping[str, SavedClock], cameras: Sequence[str], drifting: bool) -> list[str]:
    """Return lines that state the applied clocks.

    Args:
        drifting: whether drifts are applied.
    """
    width = max(len(name) for name in cameras)
    lines = [f"clocks as saved (added to the stamps, {'with' if drifting else 'without'} drifts):"]
    for name in cameras:
        text = "stamps kept"
        if name in saved:
            clock = saved[name]
            text = f"{1e3 * clock.offset_s:+8.2f} ms"
            text += f" +- {1e3 * clock.offset_sd_s:.2f}" if clock.offset_sd_s else ""
            text += f"   drift {1e6 * clock.drift:+.0f} ppm" if drifting and clock.drift else ""
            text += f"   {clock.line_delay_us:.1f} us per row" if clock.line_delay_us else ""
        lines.append(f"  {name:<{width}}  {text}")
    lines += [
        (
            f"  the clock of {name} drifts by {60e3 * saved[name].drift:+.1f} ms a minute: its offset "
            "changes, estimate it again"
        )
        for name in cameras
        if not drifting and name in saved and saved[name].drifts
    ]
    return lines
