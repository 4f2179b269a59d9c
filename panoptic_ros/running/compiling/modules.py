"""Writes Python's bytecode files (.pyc) of all modules that this package can load.

Many containers set PYTHONDONTWRITEBYTECODE, so these files are never written. Every process then compiles the
sources of all modules that it loads. This compilation takes longer than the rest of loading.

`python -m panoptic_ros.running.compiling.modules [PACKAGE]` loads all modules of a package.
"""

from __future__ import annotations

import importlib
import os
import pkgutil
import subprocess
import sys
from contextlib import suppress


def compile_modules(package: str = "panoptic_ros") -> None:
    """Write the bytecode files of a package and of its imports, where their folders are writable."""
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": ""}
    subprocess.run([sys.executable, "-m", __spec__.name, package], env=environment, check=False)


def main() -> None:
    """Import all modules of a package."""
    package = importlib.import_module((*sys.argv[1:], "panoptic_ros")[0])
    for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
        with suppress(ImportError):  # modules that need ROS, on a machine without ROS
            importlib.import_module(module.name)


if __name__ == "__main__":
    main()
