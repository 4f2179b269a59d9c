"""Find the board in the images of a recording without calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from panoptic_ros.calibration.board_detector import APPEARANCES, BoardAppearance, BoardDetector
from panoptic_ros.calibration.boards import Board, parse_board
from panoptic_ros.calibration.instants import instants_of
from panoptic_ros.calibration.target_views import TargetView
from panoptic_ros.errors import CalibrationError
from panoptic_ros.io.board_files import read_board
from panoptic_ros.running.calibration.recorded_images import open_images
from panoptic_ros.stage import Progress

Array = np.ndarray
MOST_IMAGES = 400  # per camera, in which the board is searched; more images change errors by a few percent


@dataclass(frozen=True, eq=False)
class BoardRecording:
    """Views of a board in the images of all cameras.

    Args:
        names: Names of the cameras. sizes: (width, height) px of their images.
        views: All views of the board; stamps in s since `start_ns`.
        start_ns: Stamp of the first image.
        images: Number of images that were searched, by camera.
        mirrored: Number of views that show a mirrored board, by camera.
        pictures: By camera, the view with most corners: its index in `views`, and its image (H, W) uint8.
        notices: Lines about the recording.
    """

    names: tuple[str, ...]
    sizes: tuple[tuple[int, int], ...]
    views: tuple[TargetView, ...]
    start_ns: int
    images: tuple[int, ...]
    mirrored: tuple[int, ...]
    pictures: Mapping[int, tuple[int, Array]]
    notices: tuple[str, ...]


def board_of(text: str) -> Board:
    """Return the board of a specification, or of a file that describes one.

    Raises:
        UserError: naming the fault.
    """
    return read_board(Path(text)) if Path(text).is_file() else parse_board(text)


def read_board_views(path: Path, board: Board, progress: Progress, most: int = MOST_IMAGES) -> BoardRecording:
    """Search the board in all images of a recording, see `open_images`.

    Args:
        most: Greatest number of images per camera; evenly spaced ones are used.

    Raises:
        DataError: if the recording has no images.
        CalibrationError: if fewer than two cameras see the board.
    """
    views: list[TargetView] = []
    every: list[int] = []
    pictures: dict[int, tuple[int, Array]] = {}
    tried = APPEARANCES
    done = 0
    with open_images(path) as recorded:
        names = tuple(source.camera for source in recorded.sources)
        sizes = tuple(source.image_size for source in recorded.sources)
        total = sum(source.frame_count or 0 for source in recorded.sources)
        counts, mirrored, twice = ([0] * len(names) for _ in range(3))
        for c, source in enumerate(recorded.sources):
            detector = BoardDetector(board, tried)
            step = max(1, -(-(source.frame_count or 0) // most))
            found_as: set[BoardAppearance] = set()
            for n, frame in enumerate(source):
                done += 1
                if n % step:
                    continue
                progress(done / total if total else 0.0, f"camera {source.camera}")
                counts[c] += 1
                grey = cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY)
                found = detector.detect(grey)
                if found is None:
                    continue
                if found.repeated:
                    twice[c] += 1
                    continue
                found_as.add(found.appearance)
                mirrored[c] += found.appearance.mirrored
                views.append(TargetView(c, 0, 0.0, found.numbers, found.pixels))
                every.append(frame.stamp_ns)
                if c not in pictures or len(found.numbers) > len(views[pictures[c][0]].numbers):
                    pictures[c] = (len(views) - 1, grey)
            if found_as:  # all cameras see the same print
                prints = {own.inverted for own in found_as}
                tried = tuple(own for own in tried if own.inverted in prints)
        notices = [*recorded.notices, *_two_boards(names, twice, views)]
    if not every:
        raise CalibrationError(_nothing(path, board, sum(counts)))
    start = min(every)
    seconds = np.array([(stamp - start) * 1e-9 for stamp in every])
    instants = instants_of(np.array([view.camera for view in views]), seconds)
    placed = tuple(
        TargetView(view.camera, int(instant), float(second), view.numbers, view.pixels)
        for view, instant, second in zip(views, instants, seconds)
    )
    return BoardRecording(
        names, sizes, placed, start, tuple(counts), tuple(mirrored), pictures, tuple(notices)
    )


def _two_boards(names: Sequence[str], twice: Sequence[int], views: Sequence[TargetView]) -> list[str]:
    """Return lines about images that were left out because they show two identical boards.

    Raises:
        CalibrationError: if these are most of a camera's images of the board.
    """
    lines = []
    for c, (name, count) in enumerate(zip(names, twice)):
        used = sum(view.camera == c for view in views)
        if count > used:
            raise CalibrationError(
                f"camera {name}: {count} images show two boards with the same markers; cover one, or "
                "print one with other markers"
            )
        if count:
            lines.append(f"camera {name}: {count} images with two identical boards were left out")
    return lines


def _nothing(path: Path, board: Board, images: int) -> str:
    size = f"{board.columns}x{board.rows}"
    return (
        f"{path}: none of {images} images shows the board {board.kind} {size}"
        + (f" with markers {board.dictionary}" if board.dictionary else "")
        + "; check --board: its kind, its number of columns and rows, its markers"
    )
