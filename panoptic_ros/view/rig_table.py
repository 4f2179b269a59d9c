"""What the self-check of a rig found, as a table and as a document."""
from __future__ import annotations

import math

from panoptic_ros.domain import Rig
from panoptic_ros.evaluation.rig_check import RigReport


def rig_document(report: RigReport) -> dict[str, object]:
    """{"cameras": [{camera, people, residual_px}], "notices": [...]}; what is not known is None."""
    cameras = [
        {"camera": fit.camera, "people": fit.people,
         "residual_px": None if math.isnan(fit.residual_px) else fit.residual_px}
        for fit in report.cameras
    ]  # fmt: skip
    notices = [vars(note) | {"values": dict(note.values)} for note in report.notices]
    return {"cameras": cameras, "notices": notices}


def rig_table(rig: Rig, report: RigReport) -> str:
    """One line per camera, then what is wrong, in words."""
    width = max(6, *(len(name) for name in rig.names))
    row = f"{{:{width}}}  {{:>11}}  {{:>8}}  {{:>23}}  {{:>12}}  {{:>7}}"
    lines = [row.format("camera", "image", "focal px", "position m", "rays miss px", "matched")]
    for camera, fit in zip(rig.cameras, report.cameras):
        size = f"{camera.image_size[0]} x {camera.image_size[1]}"
        focal = f"{camera.intrinsics.matrix[0, 0]:.1f}"
        place = " ".join(f"{value:7.2f}" for value in camera.centre)
        miss = "-" if math.isnan(fit.residual_px) else f"{fit.residual_px:.1f}"
        lines.append(row.format(camera.name, size, focal, place, miss, fit.people))
    lines += [f"{note.severity}: {note.text}" for note in report.notices]
    if not report.notices:
        lines.append("the views agree")
    return "\n".join(lines)
