"""What setup.cfg cannot say: installed files, and the executables of `ros2 run`."""

from __future__ import annotations

import sys
from pathlib import Path

from setuptools import setup

ROOT = Path(__file__).resolve().parent
sys.path.insert(0, str(ROOT))  # the table of stages needs nothing but the standard library
from panoptic_ros.graph.nodes import NODES  # noqa: E402

EXECUTABLES = ("rig", "camera", *NODES, "fusion", "markers", "people", "heat_maps", "rpt")

# colcon calls `setup.py install` or `setup.py develop`, pip never does. Only colcon's scripts go where
# `ros2 run` looks; pip's would go to bin/, where a script "sync" hides the system's command.
FOR_COLCON = bool({"install", "develop"} & set(sys.argv[1:]))


def installed_files() -> list[tuple[str, list[str]]]:
    """(folder, files) of share/panoptic_ros: package.xml, and config/, launch/ and bags/ as they are here."""
    folders: dict[str, list[str]] = {"share/panoptic_ros": ["package.xml"]}
    for top in ("config", "launch", "bags"):
        for path in sorted((ROOT / top).rglob("*")):
            inner = path.relative_to(ROOT)
            if path.is_file() and not any(part.startswith((".", "__")) for part in inner.parts):
                target = f"share/panoptic_ros/{inner.parent.as_posix()}"
                folders.setdefault(target, []).append(inner.as_posix())
    return list(folders.items())


setup(
    python_requires=">=3.10",  # here, as colcon cannot read it from setup.cfg
    entry_points={
        "console_scripts": [
            "panoptic = panoptic_ros.cli.main:program",
            *(f"{name} = panoptic_ros.nodes.main:{name}" for name in EXECUTABLES if FOR_COLCON),
        ]
    },
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/panoptic_ros"]),
        *installed_files(),
    ],
)
