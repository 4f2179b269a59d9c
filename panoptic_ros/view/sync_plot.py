"""Plot of a capture's camera clocks: deviation of frame times from a uniform clock, and missing frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from panoptic_ros.clocks.report import CameraClockReport
from panoptic_ros.domain import ClockModel
from panoptic_ros.io.files import atomic_path
from panoptic_ros.view.plotting import Figure, FigureCanvasAgg

PANELS = 32  # largest number of panels that fit into a picture
# ms; smallest half range of the y axis, so that rounding of perfect timestamps does not look like jitter
LEAST_RANGE_MS = 0.1


def write_sync_plot(
    path: Path, cameras: Sequence[CameraClockReport], models: Mapping[str, ClockModel]
) -> None:
    """Draw timestamp residuals of each camera's linear clock over time, one panel per camera.

    Gaps with missing frames are marked red, and the title lists the timecode drift of each device. With more
    than `PANELS` cameras, the plot shows those with the most lost frames, then those with the most jitter.

    Raises:
        EnvironmentProblem: If the file cannot be written.
    """
    worst = sorted(cameras, key=lambda camera: (-camera.timing.lost, -camera.timing.jitter_s))[:PANELS]
    total, cameras = len(cameras), [camera for camera in cameras if camera in worst]
    figure = Figure(figsize=(9.0, 1.0 + 1.7 * max(1, len(cameras))), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(max(1, len(cameras)), 1, squeeze=False, sharex=True)[:, 0]
    for axes, camera in zip(panels, cameras):
        timing = camera.timing
        times = timing.counts / timing.rate_hz
        axes.plot(times, 1e3 * timing.errors_s, ".", markersize=2)
        gaps = np.flatnonzero(np.diff(timing.counts) > 1)
        for gap in gaps[:500]:
            axes.axvspan(times[gap], times[gap + 1], color="tab:red", alpha=0.25, linewidth=0)
        low, high = axes.get_ylim()
        if high - low < 2 * LEAST_RANGE_MS:
            axes.set_ylim(0.5 * (low + high) - LEAST_RANGE_MS, 0.5 * (low + high) + LEAST_RANGE_MS)
        axes.set_ylabel("ms")
        axes.set_title(
            f"{camera.name}: {timing.rate_hz:.4f} fps, jitter {1e3 * timing.jitter_s:.2f} ms, "
            f"{timing.lost} lost",
            fontsize=9,
            loc="left",
        )
        axes.grid(alpha=0.3)
    shown = "" if len(cameras) == total else f"; the worst {len(cameras)} of {total} cameras"
    panels[-1].set_xlabel("s; stamps less those of an even clock, red where frames are missing" + shown)
    rows = [f"{name}: drift {1e6 * model.drift:+.3f} ppm" for name, model in models.items()]
    if rows:
        figure.suptitle("timecode: " + ", ".join(rows), fontsize=9)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, format="png")
