"""Import of the matplotlib parts that plots use, independent of MPLBACKEND.

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
]
