"""Errors of bodies by cameras and IMUs as a picture, as Fig. 7 of Malleson et al. 2020."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

PANELS = (("mm", "mean error of joints, mm"), ("deg", "mean error of orientations, deg"))


def body_study_plot(rows: Sequence[Mapping[str, Any]], ours: str) -> bytes:
    """A PNG: means over the captures, a line for each number of IMUs; dashed: the other method.

    Without cameras the error in mm is relative to the root.

    Args:
        rows: of the study, with cameras, imus, method, mm, relative_mm and deg.
        ours: the method that is drawn as a full line.
    """
    figure = Figure(figsize=(10.0, 4.2), layout="constrained")
    FigureCanvasAgg(figure)
    kinds = sorted({row["imus"] for row in rows})
    methods = sorted({row["method"] for row in rows}, key=lambda name: name != ours)
    for axes, (key, label) in zip(figure.subplots(1, 2), PANELS):
        for n, imus in enumerate(kinds):
            for method in methods:
                mine = [row for row in rows if (row["imus"], row["method"]) == (imus, method)]
                cameras = sorted({row["cameras"] for row in mine})
                means = [
                    np.mean([_value(row, key) for row in mine if row["cameras"] == count])
                    for count in cameras
                ]
                style = "-o" if method == ours else "--x"
                seen = cameras.index(0) + 1 if key == "mm" and 0 in cameras else 0
                axes.plot(cameras[:seen], means[:seen], style[-1], color=f"C{n}")  # another measure: no line
                axes.plot(
                    cameras[seen:], means[seen:], style, color=f"C{n}", label=f"{imus} IMUs, {method}"
                )
        axes.set(xlabel="cameras", ylabel=label, yscale="log")
        axes.grid(True, which="both", alpha=0.3)
        axes.legend(fontsize=7)
    figure.suptitle("simulated captures: no reproduction of Total Capture", fontsize=9)
    memory = io.BytesIO()
    figure.savefig(memory, format="png", dpi=120, metadata={"Software": None})
    return memory.getvalue()


def _value(row: Mapping[str, Any], key: str) -> float:
    return float(row["relative_mm" if key == "mm" and not row["cameras"] else key])
