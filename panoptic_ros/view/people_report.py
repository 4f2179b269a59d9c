"""Report of a calibration from people: table of cameras, and a page with it."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence

from panoptic_ros.calibration.quality import Quality
from panoptic_ros.view.calibration_report import STYLE, html_table, link_rows, observation_cells, text_table

HEAD = ("camera", "instants", "joints", "left out", "noise px", "image", "offset ms", "± ms")


def people_rows(quality: Quality) -> list[tuple[str, ...]]:
    """Return the rows of the table of cameras, as text."""
    return [
        (
            *observation_cells(camera),
            f"{1e3 * camera.offset_s:+.1f}",
            f"{1e3 * camera.offset_sd_s:.1f}",
        )
        for camera in quality.cameras
    ]


def people_table(quality: Quality, prediction: str) -> list[str]:
    """Return the table of cameras and the line about predicted errors as lines of text."""
    return [*text_table([HEAD, *people_rows(quality)]), prediction]


def people_page(
    quality: Quality, prediction: str, links: Mapping[tuple[int, int], int], lines: Sequence[str]
) -> str:
    """Return the report as HTML.

    Args:
        links: scores of pairs of cameras, instants of common people times the surplus of inliers.
        lines: doubts and notices.
    """
    linked = link_rows(quality, links)
    parts = [
        "<!doctype html><meta charset=utf-8><title>Calibration from people</title>",
        f"<style>{STYLE}</style><h1>Calibration from people</h1><p>{html.escape(prediction)}</p>",
        "<h2>To improve</h2><ul>" + "".join(f"<li>{html.escape(line)}</li>" for line in lines) + "</ul>"
        if lines
        else "<p>All limits of a good calibration hold.</p>",
        "<h2>Cameras</h2>" + html_table(HEAD, people_rows(quality)),
        "<h2>Links: instants in which two cameras agree on a person</h2>"
        + html_table(("", *(row[0] for row in linked)), linked),
    ]
    return "\n".join(parts) + "\n"
