"""Scene of a live calibration: small images with the corners of the board, and the state of the guide."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from panoptic_ros.calibration.guide import FEWEST_LINKS, GuideState
from panoptic_ros.calibration.quality import GOOD_VIEWS
from panoptic_ros.view.guide_table import error_line, overall_line
from panoptic_ros.view.page.mailbox import PageInstant
from panoptic_ros.view.page.packets import PageMessage
from panoptic_ros.view.page.scene import Client, PageScene

Array = np.ndarray
FINE = 65535  # corners are shares of the image's width and height, as uint16


class GuideScene(PageScene):
    """Exchange between a live calibration and the thread that serves its pages. See `LiveScene`.

    Args:
        cameras: Size (width, height) px of the images by camera.
    """

    def __init__(self, cameras: Mapping[str, tuple[int, int]]):
        super().__init__()
        self._sizes = dict(cameras)
        self._places = {name: place for place, name in enumerate(cameras)}
        self._state: dict[str, Any] = {"type": "waiting", "text": "waiting for the first images"}
        self._facts = {
            "type": "facts",
            "cameras": [{"name": name, "size": list(size)} for name, size in cameras.items()],
            "good": {"views": GOOD_VIEWS, "links": FEWEST_LINKS},
        }

    # ------------------------------------------------------------- called by the calibration

    def picture(self, camera: str, jpeg: bytes, pixels: Array) -> None:
        """Show the newest image of a camera with corners (K, 2) px of the whole image."""
        message = PageMessage(self._places[camera], packed_picture(jpeg, pixels, self._sizes[camera]))
        with self._lock:
            for client in self._clients:
                client.mailbox.offer(PageInstant(None, {}, (message,)))
                client.wake()

    def tell(self, state: GuideState, recorded: str, notices: Sequence[str]) -> None:
        """Show the newest state; see `guide_table.guide_lines`."""
        document = guide_document(state, recorded, notices)
        with self._lock:
            self._state = document

    # ------------------------------------------------------------- called by the server

    def choose(self, client: Client, keys: Sequence[str]) -> None:
        """Do nothing: a page shows all."""

    def state(self, client: Client, now_s: float) -> Mapping[str, Any]:
        """Return the newest state."""
        with self._lock:
            return self._state


def packed_picture(jpeg: bytes, pixels: Array, size: tuple[int, int]) -> bytes:
    """Return the bytes of a picture for a page: uint32 K, K times (x, y) uint16, then the JPEG."""
    shares = np.clip(np.round((pixels + 0.5) / np.array(size) * FINE), 0, FINE).astype("<u2")
    return struct.pack("<I", len(pixels)) + bytes(shares.tobytes()) + jpeg


def guide_document(state: GuideState, recorded: str, notices: Sequence[str]) -> dict[str, Any]:
    """Return the state of the guide as a JSON document."""
    return {
        "type": "guide",
        "cameras": [
            {
                "name": camera.name,
                "views": camera.views,
                "covered": camera.covered.astype(int).tolist(),
                "tilted": camera.tilted,
                "distances": camera.distances,
                "linked": camera.linked,
                "advice": camera.advice,
            }
            for camera in state.cameras
        ],
        "links": [[a, b, count] for (a, b), count in sorted(state.links.items())],
        "error_mm": None if state.error_m is None else 1e3 * state.error_m,
        "error": error_line(state),
        "advice": overall_line(state),
        "usable": state.usable,
        "enough": state.enough,
        "recorded": recorded,
        "notices": list(notices),
    }
