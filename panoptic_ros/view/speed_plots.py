"""Plot of the study `continuous`: error against the speed of the joints, one panel per case."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from panoptic_ros.io.files import atomic_path
from panoptic_ros.view.plotting import panel_grid

LEAST_MM, MOST_MM = 1.0, 300.0  # mm, limits of the errors


def write_speed_plot(
    path: Path,
    speeds: Sequence[float],
    cases: Mapping[str, Mapping[str, Sequence[float]]],
    title: str,
) -> None:
    """Draw errors against speed as PNG.

    Args:
        speeds: middle (m/s) of each group of speed.
        cases: errors (mm) per group, by case and method; NaN = none.

    Raises:
        EnvironmentProblem: If the file cannot be written.
    """
    figure, panels = panel_grid(len(cases), 3.4, 2.8)
    methods = list(dict.fromkeys(method for curves in cases.values() for method in curves))
    colours = {method: f"C{k}" for k, method in enumerate(methods)}
    for (name, curves), axes in zip(cases.items(), panels):
        for method, errors in curves.items():
            there = np.isfinite(errors)
            axes.plot(
                np.array(speeds)[there],
                np.array(errors)[there],
                "o-",
                color=colours[method],
                label=method,
                ms=3,
            )
        axes.set(title=name, yscale="log", ylim=(LEAST_MM, MOST_MM), xlim=(0.0, None))
        axes.grid(alpha=0.3, which="both")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside right upper")
    figure.suptitle(title, fontsize="medium")
    figure.supxlabel("speed of the joint [m/s]", fontsize="medium")
    figure.supylabel("mean error [mm]", fontsize="medium")
    with atomic_path(path) as temporary:
        figure.savefig(temporary)
