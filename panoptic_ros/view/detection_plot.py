"""Plot of `panoptic study detection`: error and misses over processor time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from panoptic_ros.io.files import atomic_path
from panoptic_ros.view.plotting import Axes, Figure, FigureCanvasAgg

MARKS = "osD^vP*X<>"


def write_plot(path: Path, rows: Sequence[Mapping[str, Any]], title: str) -> None:
    """Draw all detector settings as PNG. The first row is the reference that a horizontal line marks.

    Raises:
        EnvironmentProblem: If the file cannot be written.
    """
    figure = Figure(figsize=(10.5, 4.2), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2)
    _panel(left, rows, "median_mm", 1.0, "median error [mm]")
    _panel(right, rows, "pck_5", 100.0, "joints of all people within 5 cm [%]")
    figure.legend(*left.get_legend_handles_labels(), loc="outside right center", fontsize="small")
    figure.suptitle(title, fontsize="medium")
    figure.supxlabel("processor time of detection per instant [ms]", fontsize="medium")
    with atomic_path(path) as temporary:
        figure.savefig(temporary)


def _panel(axes: Axes, rows: Sequence[Mapping[str, Any]], key: str, factor: float, label: str) -> None:
    there = [row for row in rows if row[key] is not None]
    for number, row in enumerate(there):
        axes.plot(
            row["cpu_ms"],
            factor * row[key],
            MARKS[number % len(MARKS)],
            color=f"C{number % 10}",
            markersize=8,
            label=row["setting"],
        )
    if there:
        axes.axhline(factor * there[0][key], color="0.7", linewidth=1.0, zorder=0)
    axes.set(ylabel=label)
    axes.set_xlim(left=0.0)
    axes.grid(alpha=0.3)
