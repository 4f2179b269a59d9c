"""Result of the rig self-check, as a text table and as a JSON document."""

from __future__ import annotations

import math

from panoptic_ros.domain import Rig
from panoptic_ros.evaluation.rig_check import RigReport


def rig_document(report: RigReport) -> dict[str, object]:
    """Return the report as a JSON document, with None for unknown values.

    Its form is {"cameras": [{camera, people, residual_px, noise_px}], "notices": [...]}.
    """
    cameras = [
        {
            "camera": fit.camera,
            "people": fit.people,
            "residual_px": None if math.isnan(fit.residual_px) else fit.residual_px,
            "noise_px": None if math.isnan(fit.noise_px) else fit.noise_px,
        }
        for fit in report.cameras
    ]
    notices = [vars(note) | {"values": dict(note.values)} for note in report.notices]
    return {"cameras": cameras, "notices": notices}


def rig_table(rig: Rig, report: RigReport) -> str:
    """Return a text table with one line per camera, followed by the notices."""
    width = max(6, *(len(name) for name in rig.names))
    row = f"{{:{width}}}  {{:>11}}  {{:>8}}  {{:>23}}  {{:>12}}  {{:>8}}  {{:>7}}"
    lines = [row.format("camera", "image", "focal px", "position m", "rays miss px", "noise px", "matched")]
    for camera, fit in zip(rig.cameras, report.cameras):
        size = f"{camera.image_size[0]} x {camera.image_size[1]}"
        focal = f"{camera.intrinsics.matrix[0, 0]:.1f}"
        place = " ".join(f"{value:7.2f}" for value in camera.centre)
        miss, noise = (
            "-" if math.isnan(value) else f"{value:.1f}" for value in (fit.residual_px, fit.noise_px)
        )
        lines.append(row.format(camera.name, size, focal, place, miss, noise, fit.people))
    lines += [f"{note.severity}: {note.text}" for note in report.notices]
    if all(note.code == "rig.scale" for note in report.notices):  # the scale does not change the views
        lines.append("the views agree")
    return "\n".join(lines)
