"""The plot of clocks stays a picture that can be looked at, however many cameras there are."""

import cv2
import numpy as np
import pytest

from panoptic_ros.clocks.report import measure_camera
from panoptic_ros.view import sync_plot
from panoptic_ros.view.sync_plot import PANELS, write_sync_plot


@pytest.mark.parametrize(("panels", "cameras"), [(4, 4), (4, 12), (PANELS, 3 * PANELS)])
def test_pictures_stop_growing_with_the_cameras(tmp_path, monkeypatch, panels, cameras):
    monkeypatch.setattr(sync_plot, "PANELS", panels)
    stamps = (np.arange(20) * 40_000_000).tolist()
    clocks = [measure_camera(f"cam{k:03}", stamps) for k in range(cameras)]
    write_sync_plot(tmp_path / "sync.png", clocks, {})
    height, width = cv2.imread(str(tmp_path / "sync.png")).shape[:2]
    assert width == 990 and height == pytest.approx(110 * (1.0 + 1.7 * panels), abs=2)
