"""Print a calibration board to scale, or a random pattern, as PDF."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

from panoptic_ros.calibration.board_artwork import black_rectangles
from panoptic_ros.calibration.boards import Board
from panoptic_ros.calibration.pattern.artwork import random_pattern
from panoptic_ros.errors import UsageError
from panoptic_ros.io.files import write_bytes
from panoptic_ros.view.plotting import Axes, Figure, Rectangle

PAPERS = {
    "a4": (0.210, 0.297),
    "a3": (0.297, 0.420),
    "a2": (0.420, 0.594),
    "a1": (0.594, 0.841),
    "a0": (0.841, 1.189),
    "letter": (0.2159, 0.2794),
}  # m, width and height
MARGIN = 0.008  # m, that printers leave white
NOTE = 0.008  # m, height of the line of text
INCH = 0.0254  # m


def write_board(path: Path, board: Board, title: str, paper: str = "") -> str:
    """Write a board as PDF at its true size, and return the name of the paper.

    Args:
        title: specification, printed on the margin.
        paper: a name of `PAPERS`; "" = the smallest that the board fits.

    Raises:
        UsageError: if the board does not fit, or the file is not a PDF.
    """
    _check_suffix(path)
    name, width, height = _page(board, paper)
    figure, axes = _empty(width, height)
    across, down = board.extent
    left, top = 0.5 * (width - across), 0.5 * (height - NOTE - down)
    for x, y, w, h in black_rectangles(board):
        axes.add_patch(Rectangle((left + x, top + y), w, h, facecolor="black", linewidth=0.0))
    axes.text(
        0.5 * width,
        height - MARGIN,
        f"{title}   print at 100 %; the pattern must measure {1e3 * across:.1f} x {1e3 * down:.1f} mm",
        ha="center",
        va="bottom",
        fontsize=8,
    )
    _save(path, figure)
    return name


def write_pattern(path: Path, paper: str = "") -> str:
    """Write a random pattern as PDF, and return the name of the paper.

    Args:
        paper: a name of `PAPERS`; "" = the first.

    Raises:
        UsageError: if the paper is unknown, or the file is not a PDF.
    """
    _check_suffix(path)
    name = _named(paper) or next(iter(PAPERS))
    width, height = PAPERS[name]
    figure, axes = _empty(width, height)
    cells = random_pattern(width - 2.0 * MARGIN, height - 2.0 * MARGIN)
    edges = (MARGIN, width - MARGIN, height - MARGIN, MARGIN)
    axes.imshow(cells, cmap="gray_r", interpolation="nearest", extent=edges, aspect="auto")
    _save(path, figure)
    return name


def _check_suffix(path: Path) -> None:
    if path.suffix.lower() != ".pdf":
        raise UsageError(f"boards and patterns are written as .pdf, not {path.name}")


def _empty(width: float, height: float) -> tuple[Figure, Axes]:
    """Return an empty page of a width and height, m, with y down."""
    figure = Figure(figsize=(width / INCH, height / INCH))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    axes.set_xlim(0.0, width)
    axes.set_ylim(height, 0.0)
    return figure, axes


def _save(path: Path, figure: Figure) -> None:
    data = BytesIO()
    figure.savefig(data, format="pdf", metadata={"CreationDate": None})
    write_bytes(path, data.getvalue())


def _named(paper: str) -> str:
    if paper.lower() not in ("", *PAPERS):
        raise UsageError(f"unknown paper {paper}; papers are {', '.join(PAPERS)}")
    return paper.lower()


def _page(board: Board, paper: str) -> tuple[str, float, float]:
    """Return the name, width and height, m, of the paper; it is turned if the board is wider than high."""
    across, down = board.extent
    for name in [_named(paper)] if paper else PAPERS:
        short, long = PAPERS[name]
        width, height = (long, short) if across > down else (short, long)
        if across + 2.0 * MARGIN <= width and down + 2.0 * MARGIN + NOTE <= height:
            return name, width, height
    where = f"paper {paper}" if paper else "any paper up to A0"
    raise UsageError(
        f"a board of {1e3 * across:.0f} x {1e3 * down:.0f} mm does not fit {where}; make it smaller"
    )
