"""Report of a calibration: table, pictures of residuals and coverage, a page with all of them."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence

import cv2
import numpy as np

from panoptic_ros.calibration.quality import CELLS, CameraQuality, Quality
from panoptic_ros.calibration.solve import CalibratedRig

Array = np.ndarray
HEAD = (
    "camera",
    "views",
    "points",
    "left out",
    "noise px",
    "image",
    "focal sd",
    "centre sd px",
    "offset ms",
    "± ms",
)
LEFT_OUT = ("camera", "reason", "images", "files")
MAGNIFIED = 40  # times, residuals in pictures
WIDTH = 960  # px, of a picture
SEEN, MISS, CELL = (40, 200, 40), (40, 40, 255), (90, 90, 90)  # BGR
STYLE = (
    "body{font:15px sans-serif;margin:2em;max-width:64em}table{border-collapse:collapse}"
    "td,th{padding:.2em .7em;text-align:right;border-bottom:1px solid #ccc}td:first-child{text-align:left}"
    "img{max-width:31em;margin:.3em}"
)


def observation_cells(camera: CameraQuality) -> tuple[str, ...]:
    """Return the name of a camera, and the number, noise and coverage of its observations, as text."""
    return (
        camera.name,
        str(camera.views),
        str(camera.points),
        str(camera.outliers),
        f"{camera.noise_px:.2f}",
        f"{camera.coverage:.0%}",
    )


def quality_rows(quality: Quality) -> list[tuple[str, ...]]:
    """Return the rows of the table of cameras, as text."""
    return [
        (
            *observation_cells(camera),
            f"{camera.focal_sd:.2%}",
            f"{camera.centre_sd_px:.1f}",
            f"{1e3 * camera.offset_s:+.1f}",
            f"{1e3 * camera.jitter_s:.1f}",
        )
        for camera in quality.cameras
    ]


def quality_table(quality: Quality) -> list[str]:
    """Return the table of cameras and the predicted error as lines of text."""
    return [*text_table([HEAD, *quality_rows(quality)]), prediction(quality)]


def text_table(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return rows of text as lines with aligned columns, the first column to the left."""
    widths = [max(len(cell) for cell in column) for column in zip(*rows)]
    return [
        "  ".join(cell.ljust(w) if k == 0 else cell.rjust(w) for k, (cell, w) in enumerate(zip(row, widths)))
        for row in rows
    ]


def prediction(quality: Quality) -> str:
    """Return the line about the predicted error."""
    return (
        f"predicted error where the target was shown: {1e3 * quality.error_m:.2f} mm, "
        f"{1e3 * quality.worst_m:.2f} mm at the 95th percentile"
    )


def residual_picture(rig: CalibratedRig, residuals: Array, camera: int, image: Array) -> Array:
    """Return an image (H, W, 3) BGR of a camera with all its corners and their residuals, magnified.

    Args:
        residuals: (M, 2) px of `rig.seen`.
        image: (H, W) uint8 grey.
    """
    canvas = cv2.cvtColor((image * 0.6).astype(np.uint8), cv2.COLOR_GRAY2BGR)
    height, width = image.shape
    for k in range(1, CELLS[0]):
        cv2.line(canvas, (width * k // CELLS[0], 0), (width * k // CELLS[0], height), CELL, 1)
    for k in range(1, CELLS[1]):
        cv2.line(canvas, (0, height * k // CELLS[1]), (width, height * k // CELLS[1]), CELL, 1)
    own = rig.seen.cameras[rig.seen.views] == camera
    for pixel, residual in zip(rig.seen.pixels[own], residuals[own]):
        at = tuple(int(v) for v in np.round(pixel))
        to = tuple(int(v) for v in np.round(pixel + MAGNIFIED * residual))
        cv2.circle(canvas, at, 2, SEEN, -1, cv2.LINE_AA)
        cv2.line(canvas, at, to, MISS, 1, cv2.LINE_AA)
    scale = WIDTH / width
    return cv2.resize(canvas, (WIDTH, round(height * scale)), interpolation=cv2.INTER_AREA)


def report_page(
    quality: Quality,
    links: Mapping[tuple[int, int], int],
    lines: Sequence[str],
    left_out: Sequence[Sequence[str]],
    pictures: Mapping[str, str],
) -> str:
    """Return the report as HTML.

    Args:
        links: instants that link pairs of cameras.
        lines: doubts and notices.
        left_out: rows of images without use, see `LEFT_OUT`.
        pictures: file name of the picture of each camera.
    """
    linked = link_rows(quality, links)
    parts = [
        "<!doctype html><meta charset=utf-8><title>Calibration</title>",
        f"<style>{STYLE}</style><h1>Calibration</h1><p>{html.escape(prediction(quality))}</p>",
        "<h2>To improve</h2><ul>" + "".join(f"<li>{html.escape(line)}</li>" for line in lines) + "</ul>"
        if lines
        else "<p>All limits of a good calibration hold.</p>",
        "<h2>Cameras</h2>" + html_table(HEAD, quality_rows(quality)),
        "<h2>Images left out</h2>" + html_table(LEFT_OUT, left_out) if left_out else "",
        "<h2>Instants in which two cameras see the target</h2>",
        html_table(("", *(row[0] for row in linked)), linked),
        f"<h2>Corners (green) and residuals (red, {MAGNIFIED} times)</h2>",
        *(
            f'<figure><img src="{html.escape(file)}" alt="">'
            f"<figcaption>{html.escape(name)}</figcaption></figure>"
            for name, file in pictures.items()
        ),
    ]
    return "\n".join(parts) + "\n"


def link_rows(quality: Quality, links: Mapping[tuple[int, int], int]) -> list[tuple[str, ...]]:
    """Return the rows of the table of links between cameras, as text."""
    names = [camera.name for camera in quality.cameras]
    return [
        (names[a], *(str(links.get((min(a, b), max(a, b)), 0)) if a != b else "" for b in range(len(names))))
        for a in range(len(names))
    ]


def html_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table as HTML."""
    lines = ["".join(f"<th>{html.escape(cell)}</th>" for cell in head)]
    lines += ["".join(f"<td>{html.escape(cell)}</td>" for cell in row) for row in rows]
    return "<table>" + "".join(f"<tr>{line}</tr>" for line in lines) + "</table>"
