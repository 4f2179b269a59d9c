"""Find the board in the images of a folder without calibration."""

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
from panoptic_ros.capture.folder import folder_stamps, open_files
from panoptic_ros.capture.image_folder import ImageFolderSource
from panoptic_ros.capture.layout import cameras_of
from panoptic_ros.capture.video import VideoSource
from panoptic_ros.domain import Camera, Rig
from panoptic_ros.errors import CalibrationError
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.io.board_files import read_board
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


def read_board_views(
    folder: Path, board: Board, progress: Progress, most: int = MOST_IMAGES
) -> BoardRecording:
    """Search the board in all images of a folder with one video or folder of images per camera.

    Args:
        most: Greatest number of images per camera; evenly spaced ones are used.

    Raises:
        DataError: if the folder has no images.
        CalibrationError: if fewer than two cameras see the board.
    """
    files = cameras_of(folder)
    rig = _unknown_rig(files)
    stamps, times = folder_stamps(folder, files, rig.names)
    views: list[TargetView] = []
    every: list[int] = []
    pictures: dict[int, tuple[int, Array]] = {}
    tried = APPEARANCES
    done = 0
    with open_files(rig, files, stamps=stamps, times=times) as capture:
        total = capture.frame_count
        counts, mirrored, twice = ([0] * len(rig) for _ in range(3))
        for c, source in enumerate(capture.sources):
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
        notices = [*capture.notices, *_two_boards(rig.names, twice, views)]
    if not every:
        raise CalibrationError(_nothing(folder, board, sum(counts)))
    start = min(every)
    seconds = np.array([(stamp - start) * 1e-9 for stamp in every])
    instants = instants_of(np.array([view.camera for view in views]), seconds)
    placed = tuple(
        TargetView(view.camera, int(instant), float(second), view.numbers, view.pixels)
        for view, instant, second in zip(views, instants, seconds)
    )
    sizes = tuple(camera.image_size for camera in capture.rig.cameras)
    return BoardRecording(
        rig.names, sizes, placed, start, tuple(counts), tuple(mirrored), pictures, tuple(notices)
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


def _nothing(folder: Path, board: Board, images: int) -> str:
    size = f"{board.columns}x{board.rows}"
    return (
        f"{folder}: none of {images} images shows the board {board.kind} {size}"
        + (f" with markers {board.dictionary}" if board.dictionary else "")
        + "; check --board: its kind, its number of columns and rows, its markers"
    )


def _unknown_rig(files: Mapping[str, Path]) -> Rig:
    """Return a rig with the names and image sizes of the files; its lenses and poses mean nothing."""
    cameras = []
    for name, path in files.items():
        open_source = ImageFolderSource if path.is_dir() else VideoSource
        with open_source(name, path) as source:
            size = source.image_size
        focal = float(max(size))
        matrix = np.array([[focal, 0.0, 0.5 * size[0]], [0.0, focal, 0.5 * size[1]], [0.0, 0.0, 1.0]])
        cameras.append(Camera(name, size, Intrinsics(matrix, np.zeros(5)), Rigid.identity()))
    return Rig(tuple(cameras))
