"""Plot of body errors against the number of cameras and IMUs, as Fig. 7 of Malleson et al. 2020."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from panoptic_ros.view.plotting import Axes, Figure, FigureCanvasAgg

PANELS = {
    "mm": "joints, mm, global",
    "relative_mm": "joints, mm, from the root",
    "procrustes_mm": "joints, mm, after Procrustes",
    "deg": "orientations, deg, global",
}
# (key suffix of centre, key suffix of spread, line style, marker)
LINES = (("", "_std", "--", "x"), ("_median", "_mad", "-", "o"))
BESIDE = 0.09  # horizontal spacing of error bars that share a camera count, in units of the camera axis


def body_study_plot(rows: Sequence[Mapping[str, Any]], ours: str, origin: str = "") -> bytes:
    """Return a PNG with one colour per number of IMUs.

    Dashed lines show mean and standard deviation, solid lines median and MAD.
    Our method is in the upper row, the other method below, on the same scale. The global position error
    without cameras is left out because it drifts.

    Args:
        rows: Rows of the study, with cameras, imus, method, and mean, median, std and MAD of each panel.
        ours: Name of the method in the upper row.
        origin: Origin of the captures, for the title.
    """
    methods = sorted({row["method"] for row in rows}, key=lambda name: name != ours)
    figure = Figure(figsize=(15.0, 3.8 * len(methods)), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.subplots(len(methods), len(PANELS), sharex=True, sharey="col", squeeze=False)
    for method, line in zip(methods, grid):
        mine = [row for row in rows if row["method"] == method]
        for axes, (key, label) in zip(line, PANELS.items()):
            _draw(axes, mine, key)
            axes.set(title=f"{method}: {label}", xlabel="cameras")
            axes.title.set_fontsize(9)
            axes.grid(True, alpha=0.3)
    for axes in grid.flat:  # set limits after everything is drawn, because the methods share the y axis
        axes.set_ylim(bottom=0.0)
    grid[0, 0].legend(fontsize=7)
    figure.suptitle(f"dashed: mean, std; solid: median, MAD; {origin}", fontsize=9)
    memory = io.BytesIO()
    figure.savefig(memory, format="png", dpi=100, metadata={"Software": None})
    return memory.getvalue()


def _draw(axes: Axes, rows: Sequence[Mapping[str, Any]], key: str) -> None:
    """Draw all error-bar lines of one panel."""
    kinds = sorted({row["imus"] for row in rows})
    for n, imus in enumerate(kinds):
        mine = [row for row in rows if row["imus"] == imus and (row["cameras"] or key != "mm")]
        cameras = sorted({row["cameras"] for row in mine})
        for k, (middle, spread, line, marker) in enumerate(LINES):
            by_count = [[row for row in mine if row["cameras"] == count] for count in cameras]
            values = [
                [float(np.mean([row[key + end] for row in own])) for own in by_count]
                for end in (middle, spread)
            ]
            beside = np.array(cameras) + BESIDE * (2 * (n - (len(kinds) - 1) / 2) + k - 0.5)
            name = f"{imus} IMUs, {'median, MAD' if k else 'mean, std'}"
            axes.errorbar(
                beside,
                values[0],
                values[1],
                linestyle=line,
                marker=marker,
                markersize=4,
                linewidth=1.2,
                elinewidth=0.8,
                capsize=2,
                color=f"C{n}",
                label=name,
            )
