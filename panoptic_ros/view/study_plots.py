"""Plots of the studies: PCK against distance, one panel per number of people."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.io.files import atomic_path
from panoptic_ros.view.plotting import Axes, colormaps, panel_grid

END_CM = 6.0  # cm; upper end of the PCK curves
DASHES = {"HD": "C3", "VGA": "C0", "QVGA": "C2"}


def write_study_plot(path: Path, rows: Sequence[Mapping[str, Any]], title: str) -> None:
    """Draw the PCK curves of all rows as PNG.

    Raises:
        EnvironmentProblem: If the file cannot be written.
    """
    people = sorted({row["people"] for row in rows})
    figure, panels = panel_grid(len(people), 3.6, 3.0)
    for number, axes in zip(people, panels):
        _panel(axes, [row for row in rows if row["people"] == number], number)
    panels[0].legend(fontsize="small", loc="lower right")
    figure.suptitle(title, fontsize="medium")
    figure.supxlabel("distance from the truth [cm]", fontsize="medium")
    figure.supylabel("share of all joints (PCK)", fontsize="medium")
    with atomic_path(path) as temporary:
        figure.savefig(temporary)


def _panel(axes: Axes, rows: list[Mapping[str, Any]], people: int) -> None:
    counts = sorted({row["cameras"] for row in rows if row["kind"] == "given"})
    shades = dict(zip(counts, colormaps["viridis"](np.linspace(0.92, 0.0, max(len(counts), 1)))))
    methods = list(dict.fromkeys(row["method"] for row in rows))
    styles = {method: ("-", ":", "--", "-.")[k % 4] for k, method in enumerate(methods)}
    for row in rows:
        given = row["kind"] == "given"
        axes.plot(
            100.0 * np.array(row["pck_thresholds_m"]),
            row["pck"],
            color=shades[row["cameras"]] if given else DASHES[row["kind"]],
            linestyle=styles[row["method"]],
            label=f"{row['cameras']} {'cameras' if given else row['kind']}, {row['method']}",
        )
    axes.set(title=f"{people} people", xlim=(0.0, END_CM), ylim=(0.0, 1.02))
    axes.grid(alpha=0.3)
