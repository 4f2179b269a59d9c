"""Recognise calibrations of other programs that cannot be read, so that error messages can name them."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from panoptic_ros.io.rigs.document import Document

REMEDY = (
    "write its cameras as rig.json or as TOML of aniposelib, or as <camera>.yaml of ROS with poses.yaml: "
    "docs/files.md describes them"
)
Test = Callable[[Any], bool]


def _tables_with(*keys: str) -> Test:
    """Return a test of whether a document is a table of tables that have these keys."""

    def test(document: Any) -> bool:
        rows = list(document.values()) if isinstance(document, dict) else []
        return bool(rows) and all(isinstance(row, dict) and set(keys) <= set(row) for row in rows)

    return test


def _with(*keys: str) -> Test:
    """Return a test of whether a document is a table that has these keys."""
    return lambda document: isinstance(document, dict) and set(keys) <= set(document)


def _text(*patterns: str) -> Test:
    """Return a test of whether a text has, for each pattern, a line that begins with it."""
    return lambda text: all(re.search(f"^{pattern}", text, re.MULTILINE) for pattern in patterns)


# Name, syntax of `Document`, and test of the content; the first match counts.
FORMATS: tuple[tuple[str, str, Test], ...] = (
    (
        "a calibration of EasyMocap (intri.yml and extri.yml)",
        "text",
        _text("%YAML", r"(K|dist|R|Rot|T)_\S+:\s*!!opencv-matrix"),
    ),
    ("a calibration of OpenCV's FileStorage", "text", _text("%YAML", r"\s*\S+:\s*!!opencv-matrix")),
    ("a calibration of OpenCV's FileStorage", "xml", lambda root: root.tag == "opencv_storage"),
    ("a camera chain of Kalibr", "text", _text(r"\s+distortion_coeffs:", r"\s+intrinsics:")),
    ("camera_info of one camera of ROS, without its pose", "text", _text("camera_matrix:", "image_width:")),
    ("a calibration of 4D Association", "json", _tables_with("K", "RT")),
    ("a calibration of VoxelPose", "json", _tables_with("fx", "fy", "k", "p", "R", "T")),
    (
        "a list of cameras of AIST++",
        "text",
        lambda text: text.lstrip().startswith("[") and all(f'"{k}"' in text for k in ("matrix", "rotation")),
    ),
    ("a calibration of Vicon (.xcp)", "xml", lambda root: root.find("Camera/KeyFrames/KeyFrame") is not None),
    ("a scene of Meshroom", "json", _with("views", "intrinsics", "poses")),
    (
        "a scene of nerfstudio (transforms.json)",
        "json",
        lambda document: (
            isinstance(document.get("frames"), list) and "transform_matrix" in str(document["frames"][:1])
        ),
    ),
    ("a calibration of calib.io", "json", _with("Calibration")),
    (
        "a calibration of Basalt",
        "json",
        lambda document: isinstance(document.get("value0"), dict) and "T_imu_cam" in document["value0"],
    ),
    ("a list of cameras of COLMAP", "text", _text(r"#\s*CAMERA_ID, MODEL, WIDTH")),
)


def foreign_format(document: Document | None) -> str | None:
    """Return the name of a document's format, if it is one of another program."""
    if document is None:
        return None
    for name, syntax, test in FORMATS:
        if document.syntax == syntax and test(document.content):
            return name
    return None
