"""Terminal table of a live calibration: what each camera has seen of the board, and the next step."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Mapping, Sequence

from panoptic_ros.calibration.guide import CameraGuide, GuideState
from panoptic_ros.calibration.quality import GOOD_ERROR_M, GOOD_VIEWS
from panoptic_ros.view.calibration_report import text_table
from panoptic_ros.view.redrawn import RedrawnLines

HEAD = ("camera", "views", "image", "tilted", "distance m", "linked", "next step")
LINE_S = 5.0  # s between plain lines when the stream is not a terminal
ENOUGH = "enough: Ctrl-C ends the recording and calibrates"
USABLE = "usable, but not enough; Ctrl-C ends the recording and calibrates"
NOT_USABLE = "not usable yet: go on, camera by camera"


def guide_lines(state: GuideState, recorded: str, notices: Sequence[str]) -> list[str]:
    """Return the state of the guide as lines of text.

    Args:
        recorded: Line about the recording. notices: Lines about faults.
    """
    rows = [_row(camera) for camera in state.cameras]
    table = text_table([HEAD[:-1], *[row[:-1] for row in rows]])
    steps = [HEAD[-1], *[row[-1] for row in rows]]
    lines = [f"{line}  {step}" for line, step in zip(table, steps)]
    return [*lines, links_line(state), error_line(state), recorded, *notices, overall_line(state)]


def links_line(state: GuideState) -> str:
    """Return the line about the instants that each pair of cameras has in common."""
    names = [camera.name for camera in state.cameras]
    pairs = [f"{names[a]}+{names[b]} {count}" for (a, b), count in sorted(state.links.items()) if count]
    return f"seen at once: {', '.join(pairs) or 'no pair of cameras'}"


def error_line(state: GuideState) -> str:
    """Return the line about the predicted error."""
    if state.error_m is None:
        return f"not yet solvable: {state.unsolved}"
    good = f"good: at most {1e3 * GOOD_ERROR_M:g} mm"
    return f"predicted error where the board was shown: {1e3 * state.error_m:.2f} mm ({good})"


def overall_line(state: GuideState) -> str:
    """Return the line with the next step for all cameras."""
    if state.enough:
        return ENOUGH
    return state.advice or (USABLE if state.usable else NOT_USABLE)


def recorded_line(recorded: Mapping[str, int], rate_hz: float, late: int) -> str:
    """Return the line about the recording: number of files by camera, rate (Hz) and missed searches."""
    dropped = f", {late} searches left out because the computer is busy" if late else ""
    return f"{sum(recorded.values())} images recorded; {rate_hz:.1f} searches/s{dropped}"


def _row(camera: CameraGuide) -> tuple[str, ...]:
    near = "-" if camera.distances is None else "{:.1f} to {:.1f}".format(*camera.distances)
    return (
        camera.name,
        f"{camera.views}/{GOOD_VIEWS}",
        f"{camera.covered.mean():.0%}",
        str(camera.tilted),
        near,
        "yes" if camera.linked else "no",
        camera.advice or "enough",
    )


class GuideTable:
    """Table of the guide, redrawn in place in a terminal; else a plain line whenever an advice changes."""

    def __init__(self) -> None:
        self._is_terminal = sys.stdout.isatty()
        self._redrawn = RedrawnLines(sys.stdout)
        self._told, self._told_s = "", float("-inf")

    def show(self, state: GuideState, recorded: str, notices: Sequence[str]) -> None:
        """Show the newest state; see `guide_lines`."""
        now = time.monotonic()
        if self._is_terminal:
            width, height = shutil.get_terminal_size()
            lines = guide_lines(state, recorded, notices)
            self._redrawn.draw([line[:width] for line in lines[: height - 1]])
            return
        steps = [f"{camera.name}: {camera.advice}" for camera in state.cameras if camera.advice]
        line = "; ".join(
            [*steps, error_line(state), *notices, *([overall_line(state)] if state.enough else [])]
        )
        if line != self._told and now - self._told_s >= LINE_S:
            self._told, self._told_s = line, now
            print(line, flush=True)
