"""Calibrated cameras from files: several tools' formats in, one `Rig` out.

Formats are recognised by content. Inside of the program a rig is always in metres, the world
right-handed with z up, `cam_from_world` as in OpenCV; what a file does otherwise (centimetres,
millimetres, y down, subpixels, camera axes) is converted here, once.

In: rig.json ("panoptic-rig-1"), CMU Panoptic Studio JSON, calibration.json of data packs,
Qualisys .qca.txt, aniposelib and caliscope TOML, a folder of ROS camera_info YAML with poses.yaml,
calibration.cal of Total Capture. Out: all of these but the last and the data packs'.

Lenses: OpenCV's models with up to 14 terms, and its fisheye, by any name; one reader for all formats and for
live CameraInfo, `io.distortion_models`. Cameras that a file does not pose are left out, see `Rig.left_out`.
TOML files do not state their unit of length, see `read_rig`. `Rig.up` is None where a file does not tell
which way is up.
"""

from panoptic_ros.io.rigs.registry import WRITABLE, find_rig, read_rig, write_rig

__all__ = ["WRITABLE", "find_rig", "read_rig", "write_rig"]
