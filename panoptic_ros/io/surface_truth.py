"""Read body surface points from the `truth.npz` of a photoreal capture."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from panoptic_ros.evaluation.surface import SurfaceTruth
from panoptic_ros.io.arrays import arrays_of

NAME, KEYS = "truth.npz", ("times", "points", "point_bone")
# Bones of MakeHuman's default rig (prefix of the name) and our body parts. The neck is "", because its skin
# belongs to torso and head alike.
BONES = {
    "upperarm": "elbow",
    "lowerarm": "wrist",
    "wrist": "wrist",
    "metacarpal": "wrist",
    "finger": "wrist",
    "upperleg": "knee",
    "lowerleg": "ankle",
    "foot": "ankle",
    "toe": "ankle",
    "spine": "torso",
    "pelvis": "torso",
    "clavicle": "torso",
    "shoulder": "torso",
    "breast": "torso",
    "neck": "",
}


def read_surface(folder: Path) -> SurfaceTruth | None:
    """Read the surface truth of a capture folder; None if the file or its arrays are missing."""
    path = folder / NAME
    if not path.is_file():
        return None
    with arrays_of(path) as found:
        if any(key not in found for key in KEYS):
            return None
        times, points, bones = (found[key] for key in KEYS)
        stamps = np.rint(1e9 * times).astype(np.int64)
        return SurfaceTruth(stamps, points, np.vectorize(part_of_bone, otypes=[object])(bones))


def part_of_bone(name: str) -> str:
    """Return our body part of a bone, see `part_word`. Bones without an entry belong to the face: "head"."""
    word = next((word for start, word in BONES.items() if name.startswith(start)), "head")
    return word if word in ("torso", "head", "") else f"{name[-1].lower()} {word}"
