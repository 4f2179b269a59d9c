"""Import of the matplotlib parts that plots use, independent of MPLBACKEND, and a grid of panels.

The Agg canvas draws plots into files, so no backend is needed. matplotlib fails to import where MPLBACKEND
names a backend that is not installed, as in Jupyter terminals. This is the only module that imports
matplotlib; a contract test checks that.
"""

from __future__ import annotations

import os

_BACKEND = os.environ.pop("MPLBACKEND", None)
try:
    from matplotlib import colormaps
    from matplotlib.axes import Axes
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle
    from matplotlib.ticker import MaxNLocator
    from mpl_toolkits.mplot3d import Axes3D
    from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection
finally:
    if _BACKEND is not None:
        os.environ["MPLBACKEND"] = _BACKEND

__all__ = [
    "Axes",
    "Axes3D",
    "Figure",
    "FigureCanvasAgg",
    "Line3DCollection",
    "MaxNLocator",
    "Poly3DCollection",
    "Rectangle",
    "colormaps",
    "panel_grid",
]
COLUMNS = 3  # most panels side by side


def panel_grid(count: int, width: float, height: float) -> tuple[Figure, list[Axes]]:
    """Return a figure of `count` panels with common axes, and these panels.

    Args:
        width, height: Size of a panel, inches.
    """
    columns = min(COLUMNS, count)
    lines = -(-count // columns)
    figure = Figure(figsize=(0.6 + width * columns, 0.7 + height * lines), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    panels = list(figure.subplots(lines, columns, squeeze=False, sharex=True, sharey=True).ravel())
    for axes in panels[count:]:
        axes.set_axis_off()
    return figure, panels[:count]
