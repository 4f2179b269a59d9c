"""Read calibrated cameras from the formats of several tools as a `Rig`, and write them.

The content of a file determines its format. Inside the program a rig is always in metres, its world
right-handed with z up, and `cam_from_world` as in OpenCV. The readers convert other conventions (centimetres,
millimetres, y down, subpixels, camera axes).

Input formats:

- rig.json ("panoptic-rig-1")
- CMU Panoptic Studio JSON
- calibration.json of data packs (read only)
- Qualisys .qca.txt
- aniposelib and caliscope TOML
- a folder of ROS camera_info YAML with poses.yaml
- calibration.cal of Total Capture (read only)

All formats without a note can also be written.

Lenses: OpenCV's models with up to 14 terms, and its fisheye, by any name. `io.distortion_models` reads them
for all formats and for live CameraInfo. Cameras without a pose in the file are left out, see `Rig.left_out`.
TOML files do not state their unit of length, see `read_rig`. `Rig.up` is None if a file does not state the up
direction.
"""

from panoptic_ros.io.rigs.registry import WRITABLE, find_rig, read_rig, write_rig

__all__ = ["WRITABLE", "find_rig", "read_rig", "write_rig"]
