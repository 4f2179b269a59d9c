"""Plot of the effect of each term of the kinematic solve, as Table 3 and Fig. 9 of Malleson et al. 2020."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from panoptic_ros.view.plotting import Axes, Figure, FigureCanvasAgg

MEASURES = (("mm", "mm"), ("deg", "deg"))
MOST = 200.0  # percent; longest bar drawn, since the printed number still states larger increases
WEIGHT = "acceleration "  # prefix of the names of changes to the acceleration weight

Row = Mapping[str, Any]


def term_study_plot(rows: Sequence[Row], full: str) -> bytes:
    """Return a PNG of error increases by method and change, and of errors by the acceleration weight.

    Args:
        rows: Rows of the study, with method, change, mm and deg.
        full: Name of the unchanged solve, the reference.
    """
    methods = list(dict.fromkeys(row["method"] for row in rows))
    figure = Figure(figsize=(11.0, 4.6 * len(methods)), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(len(methods), 2, squeeze=False)
    for (left, right), method in zip(panels, methods):
        mine = [row for row in rows if row["method"] == method]
        changes = list(dict.fromkeys(row["change"] for row in mine))
        weighed = [name for name in changes if name.startswith(WEIGHT)]
        _draw_terms(left, mine, [name for name in changes if name not in (full, *weighed)], full)
        _draw_weights(right, mine, weighed, full)
        left.set_title(method, loc="left", fontsize=10)
    figure.suptitle("simulated captures: no reproduction of Total Capture", fontsize=9)
    memory = io.BytesIO()
    figure.savefig(memory, format="png", dpi=110, metadata={"Software": None})
    return memory.getvalue()


def _draw_terms(axes: Axes, rows: Sequence[Row], changes: Sequence[str], full: str) -> None:
    """Draw the error increase in percent under each change."""
    places = np.arange(len(changes))
    for n, (key, label) in enumerate(MEASURES):
        whole = _mean(rows, full, key)
        more = [100.0 * (_mean(rows, change, key) / whole - 1.0) for change in changes]
        drawn, name = np.minimum(more, MOST), f"{label}, of {whole:.1f}"
        bars = axes.barh(places + 0.4 * n - 0.2, drawn, 0.38, label=name)
        axes.bar_label(bars, [f"{value:+.0f}" for value in more], fontsize=7, padding=2)
    axes.set_yticks(places, changes, fontsize=8)
    axes.invert_yaxis()
    axes.margins(x=0.15)
    axes.axvline(0.0, color="k", linewidth=0.8)
    axes.set_xlabel("change, percent")
    axes.legend(fontsize=8)


def _draw_weights(axes: Axes, rows: Sequence[Row], changes: Sequence[str], full: str) -> None:
    """Draw errors against the acceleration weight or standard deviation, parsed from the change names."""
    stated = [float(name.removeprefix(WEIGHT).split()[0]) for name in changes]
    unit = " ".join(changes[0].split()[2:]) if changes else ""
    for n, (key, label) in enumerate(MEASURES):
        axes.plot(stated, [_mean(rows, name, key) for name in changes], "-o", color=f"C{n}", label=label)
        axes.axhline(_mean(rows, full, key), color=f"C{n}", linestyle="--", label=f"{label}, as it is")
    axes.set_xscale("log")
    axes.set_xticks(stated, [f"{value:g}" for value in stated])
    axes.set_xticks([], minor=True)
    axes.set_ylim(bottom=0.0)
    label = f"standard deviation of accelerations, {unit}" if unit else "weight of the acceleration term"
    axes.set_xlabel(label)
    axes.grid(True, alpha=0.3)
    axes.legend(fontsize=8)


def _mean(rows: Sequence[Row], change: str, key: str) -> float:
    return float(np.mean([row[key] for row in rows if row["change"] == change]))
