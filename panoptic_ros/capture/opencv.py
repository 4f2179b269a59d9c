"""Suppress the log output of OpenCV and FFmpeg: our errors have one line, FFmpeg's have many."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import cv2

# OpenCV reads it at its first use of FFmpeg, so it is set before; -8 = quiet
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")


_lock = threading.Lock()
_inside = 0  # number of threads inside `quiet_opencv`
_level_before = 0


@contextmanager
def quiet_opencv() -> Iterator[None]:
    """Silence the log messages of OpenCV; several threads may enter at once."""
    global _inside, _level_before
    with _lock:
        if _inside == 0:
            _level_before = cv2.utils.logging.getLogLevel()
            cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
        _inside += 1
    try:
        yield
    finally:
        with _lock:
            _inside -= 1
            if _inside == 0:
                cv2.utils.logging.setLogLevel(_level_before)
