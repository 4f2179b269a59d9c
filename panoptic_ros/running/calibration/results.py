"""Write a calibration: the report first, then the clocks, then the rig, each file whole or not at all."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

from panoptic_ros.calibration.bundle import residuals_of
from panoptic_ros.io.clock_files import write_offsets
from panoptic_ros.io.files import write_bytes
from panoptic_ros.io.rigs import write_rig
from panoptic_ros.running.calibration.calibrate import BoardCalibration
from panoptic_ros.running.calibration.recorded_board import LeftOut
from panoptic_ros.view.calibration_report import report_page, residual_picture
from panoptic_ros.view.pictures import write_image

RIG, CLOCKS, PAGE = "rig.json", "clocks.json", "report.html"
NO_POSE, CONTRADICTS = "its corners give no pose", "most of its corners contradict the other images"
MOST_FILES = 8  # images that a row of the report names


def write_calibration(folder: Path, found: BoardCalibration) -> list[str]:
    """Write rig.json, clocks.json, report.html and its pictures to a folder.

    Returns:
        the names of the files without pictures. clocks.json is written if an offset was estimated.
    """
    folder.mkdir(parents=True, exist_ok=True)
    residuals = residuals_of(found.solved.seen, found.solved.state)
    pictures = {}
    for camera, (_, image) in sorted(found.recording.pictures.items()):
        name = found.recording.names[camera]
        pictures[name] = f"{name}.png"
        write_image(folder / pictures[name], residual_picture(found.solved, residuals, camera, image))
    lines = (*found.doubts, *found.notices)
    page = report_page(found.quality, found.solved.links, lines, left_out_rows(found), pictures)
    write_bytes(folder / PAGE, page.encode())
    offsets = {
        camera.name: (camera.offset_s, camera.offset_sd_s, c == 0 or camera.offset_sd_s > 0.0)
        for c, camera in enumerate(found.quality.cameras)
    }
    estimated = any(deviation > 0.0 for _, deviation, _ in offsets.values())
    if estimated:
        write_offsets(folder / CLOCKS, offsets, found.recording.start_ns)
    write_rig(folder / RIG, found.rig)
    return [RIG, *([CLOCKS] if estimated else []), PAGE]


def left_out_rows(found: BoardCalibration) -> list[tuple[str, ...]]:
    """Return camera, reason, number and names of the images of a board that the calibration does not use."""
    recording, solved = found.recording, found.solved
    used = {
        (view.camera, view.stamp_s): not wrong
        for view, wrong in zip(solved.views, solved.rejected, strict=False)  # free points have no views
    }
    every = list(recording.left_out)
    for view, file in zip(recording.views, recording.files, strict=False):  # wands have no files
        place = view.camera, view.stamp_s
        if not used.get(place, False):
            reason = CONTRADICTS if place in used else NO_POSE
            every.append(LeftOut(recording.names[view.camera], file, reason))
    files = defaultdict[tuple[int, str], list[str]](list)
    for one in every:
        files[recording.names.index(one.camera), one.reason].append(one.image)
    return [
        (recording.names[camera], reason, str(len(own)), _listed(own))
        for (camera, reason), own in sorted(files.items())
    ]


def _listed(files: list[str]) -> str:
    more = len(files) - MOST_FILES
    return ", ".join(files[:MOST_FILES]) + (f" and {more} more" if more > 0 else "")
