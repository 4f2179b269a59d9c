"""The parts of matplotlib that plots use, loaded whatever MPLBACKEND says.

Plots are drawn into files by the Agg canvas, so no backend is needed. matplotlib refuses to load where
MPLBACKEND names a backend that is not installed, as in terminals of Jupyter. This is the only module that
imports it; a contract test checks that.
"""

from __future__ import annotations

import os

_BACKEND = os.environ.pop("MPLBACKEND", None)
try:
    from matplotlib import colormaps
    from matplotlib.axes import Axes
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
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
    "colormaps",
]
