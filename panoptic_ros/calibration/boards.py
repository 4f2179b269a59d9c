"""Calibration boards: ChArUco, checkerboard, AprilGrid, and their points in metres."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from panoptic_ros.errors import UsageError, shown
from panoptic_ros.geometry import Rigid
from panoptic_ros.geometry.rotations import rotations_of

Array = np.ndarray
BoardKind = Literal["charuco", "checkerboard", "aprilgrid"]
KINDS: tuple[BoardKind, ...] = ("charuco", "checkerboard", "aprilgrid")
UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254}
DICTIONARIES = {name: getattr(cv2.aruco, name) for name in sorted(dir(cv2.aruco)) if name.startswith("DICT_")}
DEFAULT_DICTIONARY = "DICT_4X4_50"
APRIL_DICTIONARY = "DICT_APRILTAG_36h11"  # family of Kalibr's grids
MARKER = 0.75  # side of the marker of a ChArUco board over that of a square
GAP = 0.3  # gap between the tags of an AprilGrid over their side, as in Kalibr
FEWEST, MOST = 2, 100  # rows and columns
SPECIFICATION = re.compile(
    r"(?P<kind>[a-z]+):(?P<columns>\d+)x(?P<rows>\d+):(?P<size>[0-9.]+)(?P<unit>[a-z]+)"
    r"(?:/(?P<part>[0-9.]+)(?P<part_unit>[a-z]+))?(?::(?P<dictionary>DICT_\w+))?"
)
EXAMPLES = (
    "charuco:5x7:40mm (squares; markers of another size: charuco:5x7:40mm/30mm), checkerboard:9x6:25mm "
    "(inner corners), aprilgrid:6x6:88mm (tags; another gap: aprilgrid:6x6:88mm/26mm)"
)


@dataclass(frozen=True)
class Board:
    """Flat board with known points, in its plane z = 0.

    ChArUco boards and checkerboards have x to the right and y down, as in OpenCV. The first tag of an
    AprilGrid is at the lower left, and y points up, as in Kalibr.

    Args:
        kind: Kind of the board.
        columns, rows: Squares of a ChArUco board, inner corners of a checkerboard, tags of an AprilGrid.
        size: Side, m, of a square or tag.
        part: Side, m, of the markers of a ChArUco board, or gap between the tags of an AprilGrid.
        dictionary: Name of the markers in OpenCV; "" for a checkerboard.
        legacy: Pattern of ChArUco boards before OpenCV 4.6.

    Raises:
        UsageError: on impossible values.
    """

    kind: BoardKind
    columns: int
    rows: int
    size: float
    part: float = 0.0
    dictionary: str = ""
    legacy: bool = False

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise UsageError(f"unknown board {shown(self.kind)}; boards are {', '.join(KINDS)}")
        if not all(FEWEST <= count <= MOST for count in (self.columns, self.rows)):
            raise UsageError(
                f"a board of {self.columns} x {self.rows}; give {FEWEST} to {MOST} columns and rows"
            )
        if not 1e-4 <= self.size <= 10.0:
            raise UsageError(f"squares of {self.size:g} m; give 0.1 mm to 10 m")
        if self.kind == "charuco" and not 0.0 < self.part < self.size:
            raise UsageError(
                f"markers of {1e3 * self.part:g} mm do not fit in squares of {1e3 * self.size:g} mm"
            )
        if self.kind != "checkerboard" and self.dictionary not in DICTIONARIES:
            raise UsageError(
                f"unknown markers {shown(self.dictionary)}; OpenCV has {', '.join(DICTIONARIES)}"
            )

    @property
    def points(self) -> Array:
        """Return the points (N, 3) m of the board, in its plane z = 0, in the order of their numbers."""
        if self.kind == "aprilgrid":
            x, y = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
            corner = np.array(
                [[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]]
            )  # from the upper left, clockwise
            pitch = self.size + self.part
            flat = np.stack([x.ravel(), y.ravel()], 1)[:, None] * pitch + corner[None] * self.size
            return np.pad(flat.reshape(-1, 2), ((0, 0), (0, 1)))
        inner = 1 if self.kind == "charuco" else 0
        x, y = np.meshgrid(np.arange(self.columns - inner), np.arange(self.rows - inner))
        return self.size * np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)

    @property
    def extent(self) -> tuple[float, float]:
        """Return width and height, m, of the printed pattern."""
        if self.kind == "aprilgrid":
            pitch = self.size + self.part
            return self.columns * pitch + self.part, self.rows * pitch + self.part
        outer = 1 if self.kind == "checkerboard" else 0
        return (self.columns + outer) * self.size, (self.rows + outer) * self.size

    @property
    def turns(self) -> tuple[Rigid, ...]:
        """Return the turns about its centre, but for none, after which a checkerboard may look the same.

        OpenCV numbers the corners of such boards by the image, so views of one instant may disagree.
        """
        if self.kind != "checkerboard" or (self.columns + self.rows) % 2:
            return ()
        centre, quarters = self.points.mean(axis=0), (1, 2, 3) if self.columns == self.rows else (2,)
        turned = rotations_of(np.array([[0.0, 0.0, 0.5 * np.pi * k] for k in quarters]))
        return tuple(Rigid(turn, centre - turn @ centre) for turn in turned)


def parse_board(text: str) -> Board:
    """Return the board of a specification such as `charuco:5x7:40mm`.

    Raises:
        UsageError: naming the part that is wrong.
    """
    found = SPECIFICATION.fullmatch(text.strip())
    if not found:
        raise UsageError(f"board {shown(text)} is not understood; examples: {EXAMPLES}")
    for name in ("unit", "part_unit"):
        if found[name] is not None and found[name] not in UNITS:
            raise UsageError(f"board {shown(text)}: unknown unit {found[name]}; units are {', '.join(UNITS)}")
    kind: str = found["kind"]
    if kind not in KINDS:
        raise UsageError(f"board {shown(text)}: unknown board {kind}; boards are {', '.join(KINDS)}")
    try:
        size = float(found["size"]) * UNITS[found["unit"]]
        part = float(found["part"]) * UNITS[found["part_unit"]] if found["part"] else None
    except ValueError:
        raise UsageError(f"board {shown(text)}: sizes must be numbers; examples: {EXAMPLES}") from None
    if kind == "checkerboard":
        if part is not None or found["dictionary"]:
            raise UsageError(f"board {shown(text)}: a checkerboard has no markers")
        return Board("checkerboard", int(found["columns"]), int(found["rows"]), size)
    usual = {"charuco": (MARKER, DEFAULT_DICTIONARY), "aprilgrid": (GAP, APRIL_DICTIONARY)}[kind]
    return Board(
        "charuco" if kind == "charuco" else "aprilgrid",
        int(found["columns"]),
        int(found["rows"]),
        size,
        usual[0] * size if part is None else part,
        found["dictionary"] or usual[1],
    )
