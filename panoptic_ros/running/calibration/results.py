"""Write a calibration: the report first, then the clocks, then the rig, each file whole or not at all."""

from __future__ import annotations

from pathlib import Path

from panoptic_ros.calibration.bundle import residuals_of
from panoptic_ros.io.clock_files import write_offsets
from panoptic_ros.io.files import write_bytes
from panoptic_ros.io.rigs import write_rig
from panoptic_ros.running.calibration.calibrate import BoardCalibration
from panoptic_ros.view.calibration_report import report_page, residual_picture
from panoptic_ros.view.pictures import write_image

RIG, CLOCKS, PAGE = "rig.json", "clocks.json", "report.html"


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
    page = report_page(found.quality, found.solved.links, (*found.doubts, *found.notices), pictures)
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
