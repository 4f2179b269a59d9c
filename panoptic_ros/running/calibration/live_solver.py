"""Calibrate the views of a live recording so far, in a thread beside the recording."""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace

import cv2
import numpy as np

from panoptic_ros.calibration.boards import Board
from panoptic_ros.calibration.guide import CalibrationGuide
from panoptic_ros.calibration.instants import instants_of
from panoptic_ros.calibration.quality import Quality, quality_of
from panoptic_ros.calibration.rig_start import CameraInput
from panoptic_ros.calibration.solve import calibrate_rig
from panoptic_ros.calibration.target_views import TargetView
from panoptic_ros.errors import CalibrationError

Array = np.ndarray
PERIOD_S = 3.0  # s from the end of a calibration to the next one, at least
REST = 2.0  # times the duration of the last calibration: the solver takes at most a third of a core


class LiveSolver:
    """Solver of the views of a guide, one calibration at a time. A context manager.

    Args:
        synchronous: Estimate no clock offsets.
    """

    def __init__(self, cameras: Sequence[CameraInput], board: Board, synchronous: bool):
        self._cameras, self._board, self._clocks = tuple(cameras), board, not synchronous
        self._pool = ThreadPoolExecutor(1)
        self._running: Future[tuple[Quality, Array] | str] | None = None
        self._solved, self._begun_s, self._due_s = 0, 0.0, 0.0

    def update(self, guide: CalibrationGuide) -> None:
        """Give a finished result to the guide, and begin the next calibration if views are new."""
        if self._running is not None:
            if not self._running.done():
                return
            result, self._running = self._running.result(), None
            now = time.monotonic()
            self._due_s = now + max(PERIOD_S, REST * (now - self._begun_s))
            if isinstance(result, str):
                guide.not_solved(result)
            else:
                guide.solved(*result)
        views = guide.views
        if len(views) > self._solved and time.monotonic() >= self._due_s:
            self._solved, self._begun_s = len(views), time.monotonic()
            self._running = self._pool.submit(self._solve, views)

    def _solve(self, views: Sequence[TargetView]) -> tuple[Quality, Array] | str:
        """Return the quality and the lenses (C, 12), or the reason without them."""
        instants = instants_of(
            np.array([view.camera for view in views]), np.array([view.stamp_s for view in views])
        )
        placed = [replace(view, instant=int(instant)) for view, instant in zip(views, instants)]
        try:
            with np.errstate(all="ignore"):  # few views may overflow
                rig = calibrate_rig(
                    self._cameras, placed, self._board.points, self._clocks, self._board.turns
                )
                return quality_of(rig), rig.state.cameras.lenses
        except CalibrationError as error:
            return str(error)
        except (np.linalg.LinAlgError, cv2.error):  # few views can be degenerate in any step
            return "the views so far are too few or too similar"

    def __enter__(self) -> LiveSolver:
        return self

    def __exit__(self, *exception: object) -> None:
        self._pool.shutdown(wait=True, cancel_futures=True)
