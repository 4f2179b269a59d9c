"""Opening OpenCV's captures without its chatter: our errors are one line, FFmpeg's are many."""
from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

import cv2

# read by OpenCV when it first uses FFmpeg, so it is set before that; -8 = quiet
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")


@contextmanager
def quiet_opencv() -> Iterator[None]:
    """Silence the messages of OpenCV itself."""
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        cv2.utils.logging.setLogLevel(level)
