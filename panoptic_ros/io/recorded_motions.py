"""Read recorded motions, installed or from files."""

from __future__ import annotations

from pathlib import Path

from panoptic_ros.io.arrays import arrays_of
from panoptic_ros.io.resources import share_folder
from panoptic_ros.simulation.bodies.motion import Clip, clips_of

MOTION = "cmu-motion.npz"


def read_clips(path: Path | None = None) -> dict[str, Clip]:
    """Read the recorded motions of our skeleton in a file; {} if the file holds other arrays.

    Args:
        path: None = the installed motions; NOTICE states their origin.
    """
    path = path or share_folder() / "config" / "bodies" / MOTION
    with arrays_of(path) as found:
        arrays = dict(found)
        ours = "clips" in arrays and all(f"vectors_{name}" in arrays for name in arrays["clips"])
        return clips_of(arrays) if ours else {}
