"""Find the board in image messages of live cameras, and keep these images as files."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import cv2
import numpy as np

from panoptic_ros.calibration.board_detector import APPEARANCES, BoardDetector
from panoptic_ros.calibration.boards import Board
from panoptic_ros.capture.image_recorder import RecordedImage
from panoptic_ros.domain import ViewFrame
from panoptic_ros.errors import DataError
from panoptic_ros.io.messages import frame_from_message
from panoptic_ros.io.messages.family import decode_cdr
from panoptic_ros.io.previews import make_preview

Array = np.ndarray
JPEG = b"\xff\xd8\xff"
FAST = (cv2.IMWRITE_PNG_COMPRESSION, 1)  # the level of zlib changes the size of photographs by some percent


class SearchedImage(NamedTuple):
    """Image of a camera in which the board was searched.

    Args:
        stamp_ns: Its stamp.
        size: (width, height) px.
        numbers, pixels: (K,), (K, 2) px: corners of the board; K = 0 without a board.
        preview: JPEG of the whole image, small.
        file: Whole image as a file; None without a board.
    """

    stamp_ns: int
    size: tuple[int, int]
    numbers: Array
    pixels: Array
    preview: bytes
    file: RecordedImage | None


class LiveBoardSearch:
    """Search of the board in the images of one camera. Different cameras may search at the same time.

    Args:
        encoding: overrides the encoding in the messages; "" = it is right.
    """

    def __init__(self, camera: str, board: Board, encoding: str = ""):
        self._camera, self._board, self._encoding = camera, board, encoding
        self._detector = BoardDetector(board)
        self._is_known = False
        self.faults = 0  # messages without a usable image
        self.repeated = 0  # images with two identical boards

    def search(self, stamp_ns: int, kind: str, data: bytes) -> SearchedImage | None:
        """Return a searched image; None if the message has no usable one.

        Args:
            kind: Message type. data: CDR bytes.
        """
        try:
            message = decode_cdr(data, kind)
            image = frame_from_message(message, self._camera, 0, self._encoding).image
        except DataError:
            self.faults += 1
            return None
        grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        found = self._detector.detect(grey)
        size = (grey.shape[1], grey.shape[0])
        preview = make_preview(ViewFrame(self._camera, stamp_ns, 0, image)).jpeg
        if found is None or found.repeated:
            self.repeated += found is not None
            return SearchedImage(stamp_ns, size, np.zeros(0, np.int64), np.zeros((0, 2)), preview, None)
        if not self._is_known:  # prints do not change; fewer appearances save most of the time
            self._is_known = True
            same = tuple(own for own in APPEARANCES if own.inverted == found.appearance.inverted)
            self._detector = BoardDetector(self._board, same)
        file = _file_of(message, grey, stamp_ns, bool(self._encoding))
        return SearchedImage(stamp_ns, size, found.numbers, found.pixels, preview, file)


def _file_of(message: Any, grey: Array, stamp_ns: int, is_mosaic: bool) -> RecordedImage:
    """Return a JPEG message as it came, and any other image as a grey PNG, as the detector saw it."""
    data = bytes(message.data) if hasattr(message, "format") else b""
    stated = str(getattr(message, "format", "")).lower()
    if data.startswith(JPEG) and not is_mosaic and "bayer" not in stated:
        return RecordedImage(stamp_ns, ".jpg", data)
    return RecordedImage(stamp_ns, ".png", cv2.imencode(".png", grey, FAST)[1].tobytes())


def files_of(images: Mapping[str, SearchedImage]) -> dict[str, RecordedImage]:
    """Return the files of the images that show a board, by camera."""
    return {name: image.file for name, image in images.items() if image.file is not None}
