"""The plot of terms has a bar for each change and a point for each weight."""

import cv2
import numpy as np
import pytest
from matplotlib.axes import Axes

from panoptic_ros.view.term_study_plot import term_study_plot

FULL = "all terms"


def row(method, change, mm, deg):
    return {"method": method, "change": change, "mm": mm, "deg": deg}


@pytest.fixture
def drawn(monkeypatch):
    """What is drawn: bars and lines."""
    found = {"bars": [], "lines": []}
    barh, plot = Axes.barh, Axes.plot
    monkeypatch.setattr(Axes, "barh", lambda *a, **k: found["bars"].append(list(a[2])) or barh(*a, **k))
    monkeypatch.setattr(Axes, "plot", lambda *a, **k: found["lines"].append((a[1], a[2])) or plot(*a, **k))
    return found


def test_changes_are_percents_and_weights_are_in_order(drawn):
    rows = []
    for mm in (10.0, 30.0):  # two captures: means are 20, 30 and 10
        rows += [row("ours", FULL, mm, 5.0), row("ours", "no prior", mm + 10.0, 4.0)]
        rows += [row("ours", "acceleration 0.5 m/s^2", mm - 10.0, 6.0)]
        rows += [row("paper", FULL, mm, 5.0), row("paper", "acceleration 0.001", 2.0 * mm, 10.0)]
    picture = cv2.imdecode(np.frombuffer(term_study_plot(rows, FULL), np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None and picture.std() > 1.0
    assert drawn["bars"] == [pytest.approx([50.0]), pytest.approx([-20.0]), [], []]
    assert drawn["lines"] == [([0.5], [10.0]), ([0.5], [6.0]), ([0.001], [40.0]), ([0.001], [10.0])]
