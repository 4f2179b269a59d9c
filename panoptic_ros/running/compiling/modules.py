"""Python's own compiled files, of all modules that this package can load.

Where PYTHONDONTWRITEBYTECODE is set, as many containers do, nobody writes them: every process that starts
compiles the sources of all modules that it loads then, which takes longer than all the rest of loading.

`python -m panoptic_ros.running.compiling.modules [PACKAGE]` loads them all.
"""

from __future__ import annotations

import importlib
import os
import pkgutil
import subprocess
import sys
from contextlib import suppress


def compile_modules(package: str = "panoptic_ros") -> None:
    """Let Python keep what it makes of the sources of a package and of all that it loads, if it can write."""
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": ""}
    subprocess.run([sys.executable, "-m", __spec__.name, package], env=environment, check=False)


def main() -> None:
    """Load all modules of a package."""
    package = importlib.import_module((*sys.argv[1:], "panoptic_ros")[0])
    for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
        with suppress(ImportError):  # what needs ROS, where there is none
            importlib.import_module(module.name)


if __name__ == "__main__":
    main()
