"""A copy of the checkout's own files, so that builds leave nothing behind in it."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

import panoptic_ros

ROOT = Path(panoptic_ros.__file__).resolve().parent.parent
FILES = ("setup.py", "setup.cfg", "pyproject.toml", "package.xml", "MANIFEST.in", "LICENSE")
FOLDERS = ("panoptic_ros", "config", "launch", "resource", "msg_defs")


@pytest.fixture(scope="session")
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The copy, in a folder with a space in its name."""
    copy = tmp_path_factory.mktemp("a checkout") / "panoptic ros"
    copy.mkdir()
    for name in FILES:
        shutil.copy2(ROOT / name, copy / name)
    ignored = shutil.ignore_patterns("__pycache__", "build", "*.egg-info", "*.nbi", "*.nbc")
    for name in FOLDERS:
        shutil.copytree(ROOT / name, copy / name, ignore=ignored)
    return copy
