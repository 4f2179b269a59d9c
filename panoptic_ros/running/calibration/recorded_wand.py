"""Find a wand in the images of a recording without calibration."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from panoptic_ros.calibration.instants import instants_of
from panoptic_ros.calibration.target_views import TargetView
from panoptic_ros.calibration.wands import Wand, bright_spots, in_wand_order, without_lamps
from panoptic_ros.errors import CalibrationError
from panoptic_ros.running.calibration.recorded_board import BoardRecording
from panoptic_ros.running.calibration.recorded_images import open_images
from panoptic_ros.stage import Progress

Array = np.ndarray
MOST_IMAGES = 2000  # per camera: a wand needs more places than a board


def read_wand_views(path: Path, wand: Wand, progress: Progress, most: int = MOST_IMAGES) -> BoardRecording:
    """Search the wand in the images of a recording; only images that show all markers and no others count.

    Raises:
        DataError: if the recording has no images.
        CalibrationError: if no image shows all markers.
    """
    found: list[tuple[int, int, Array]] = []
    counts: list[int] = []
    pictures: dict[int, tuple[int, Array]] = {}
    done = 0
    with open_images(path) as recorded:
        names = tuple(source.camera for source in recorded.sources)
        sizes = tuple(source.image_size for source in recorded.sources)
        total = sum(source.frame_count or 0 for source in recorded.sources)
        for c, source in enumerate(recorded.sources):
            step = max(1, -(-(source.frame_count or 0) // most))
            stamps, spots = [], []
            for n, frame in enumerate(source):
                done += 1
                if n % step:
                    continue
                progress(done / total if total else 0.0, f"camera {source.camera}")
                grey = cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY)
                stamps.append(frame.stamp_ns)
                spots.append(bright_spots(grey))
                if len(spots[-1]) >= len(wand.markers):
                    pictures[c] = (len(found), grey)
            counts.append(len(stamps))
            for stamp, own in zip(stamps, without_lamps(spots)):
                if len(own) == len(wand.markers):
                    found.append((c, stamp, in_wand_order(wand, own)))
        notices = tuple(recorded.notices)
    if not found:
        raise CalibrationError(
            f"{path}: none of {sum(counts)} images shows {len(wand.markers)} bright markers that move; darken "
            "the room, shorten the exposure, or check the number of markers"
        )
    start = min(stamp for _, stamp, _ in found)
    cameras, seconds = np.array([c for c, _, _ in found]), np.array([(t - start) * 1e-9 for _, t, _ in found])
    numbers = np.arange(len(wand.markers))
    views = tuple(
        TargetView(c, int(instant), float(second), numbers, pixels)
        for (c, _, pixels), instant, second in zip(found, instants_of(cameras, seconds), seconds)
    )
    return BoardRecording(
        names, sizes, views, start, tuple(counts), (0,) * len(names), pictures, notices
    )
