"""Find the board in the images of a recording without calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from panoptic_ros.calibration.board_detector import APPEARANCES, FEWEST, BoardAppearance, BoardDetector
from panoptic_ros.calibration.boards import Board, parse_board
from panoptic_ros.calibration.depth_scale import SeenDepths
from panoptic_ros.calibration.instants import instants_of
from panoptic_ros.calibration.target_views import TargetView
from panoptic_ros.capture.depth_folder import DepthSource
from panoptic_ros.errors import CalibrationError
from panoptic_ros.io.board_files import read_board
from panoptic_ros.running.calibration.recorded_images import image_names, open_images
from panoptic_ros.stage import Progress

Array = np.ndarray
TWO_BOARDS, FEW_CORNERS = "two boards with the same markers", f"fewer than {FEWEST} corners"
MARKERS_OF_A_BOARD = 4  # markers in an image that prove a board; texture shows single ones
AROUND_PX = 2  # px, half width of the window of a corner's depth
MOST_IMAGES = 400  # per camera, in which the board is searched; more images change errors by a few percent


class LeftOut(NamedTuple):
    """Image that gives no view: its camera, the name of its file or its number, and the reason."""

    camera: str
    image: str
    reason: str


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
        depths: Depth at the corners, of cameras with depth maps.
        files: Name of the image of each view; empty = unknown.
        left_out: Images that were searched and gave no view.
    """

    names: tuple[str, ...]
    sizes: tuple[tuple[int, int], ...]
    views: tuple[TargetView, ...]
    start_ns: int
    images: tuple[int, ...]
    mirrored: tuple[int, ...]
    pictures: Mapping[int, tuple[int, Array]]
    notices: tuple[str, ...]
    depths: tuple[SeenDepths, ...] = ()
    files: tuple[str, ...] = ()
    left_out: tuple[LeftOut, ...] = ()


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
    shown: list[str] = []
    left_out: list[LeftOut] = []
    depths: list[tuple[int, Array]] = []
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
            files = image_names(source)
            for n, frame in enumerate(source):
                done += 1
                if n % step:
                    continue
                progress(done / total if total else 0.0, f"camera {source.camera}")
                counts[c] += 1
                grey = cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY)
                found = detector.detect(grey)
                number = frame.frame_number
                file = files[number] if number < len(files) else f"image {number}"
                if found is None or found.repeated:
                    twice[c] += found is not None
                    reason = _reason(*detector.partial) if found is None else TWO_BOARDS
                    left_out.append(LeftOut(source.camera, file, reason))
                    continue
                found_as.add(found.appearance)
                mirrored[c] += found.appearance.mirrored
                views.append(TargetView(c, 0, 0.0, found.numbers, found.pixels))
                every.append(frame.stamp_ns)
                shown.append(file)
                if isinstance(source, DepthSource):
                    depths.append(
                        (
                            len(views) - 1,
                            depth_at(source.depth_of(frame).depth, found.pixels, source.image_size),
                        )
                    )
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
    of_corners = tuple(
        SeenDepths(placed[k].camera, placed[k].stamp_s, placed[k].pixels, own) for k, own in depths
    )
    return BoardRecording(
        names,
        sizes,
        placed,
        start,
        tuple(counts),
        tuple(mirrored),
        pictures,
        tuple(notices),
        of_corners,
        tuple(shown),
        tuple(left_out),
    )


def _reason(corners: int, markers: int) -> str:
    """Return why an image gives no view, given the corners and markers of the board in it."""
    if markers >= MARKERS_OF_A_BOARD and not corners:
        return "markers but no corners of the board: is --board right?"
    return FEW_CORNERS if corners else "the board is not found: out of view, covered or blurred"


def depth_at(depth: Array, pixels: Array, image_size: tuple[int, int]) -> Array:
    """Return the median depth (K,) m of a map (H, W) m around pixels (K, 2) of its image; NaN = unknown.

    Args:
        image_size: (width, height) px of the image, which has the same field of view.
    """
    height, width = depth.shape
    found = np.full(len(pixels), np.nan)
    places = (pixels + 0.5) * np.array([width, height]) / np.array(image_size) - 0.5
    for k, (x, y) in enumerate(np.round(places).astype(int)):
        window = depth[max(y - AROUND_PX, 0) : y + AROUND_PX + 1, max(x - AROUND_PX, 0) : x + AROUND_PX + 1]
        known = window[window > 0.0]
        if 0 <= x < width and 0 <= y < height and 2 * len(known) > window.size:
            found[k] = np.median(known)
    return found


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
