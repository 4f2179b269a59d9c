"""Locate the files installed with the package, and the user's state and cache folders."""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

import panoptic_ros
from panoptic_ros.errors import EnvironmentProblem


def share_folder() -> Path:
    """Return the folder that holds config/ and bags/: the checkout, or share/panoptic_ros.

    Raises:
        EnvironmentProblem: if the installation is incomplete.
    """
    checkout = Path(panoptic_ros.__file__).resolve().parent.parent
    prefixes = [Path(p) for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p]
    places = [checkout, *(p / "share" / "panoptic_ros" for p in [Path(sys.prefix), *prefixes])]
    for place in places:
        if (place / "config" / "skeletons").is_dir():
            return place
    raise EnvironmentProblem(
        "the installed files of panoptic_ros (config/) are missing; searched in "
        + ", ".join(str(place) for place in places)
        + "; install the package again"
    )


def state_folder() -> Path:
    """Return the folder of persistent program state: panoptic_ros in XDG_STATE_HOME or ~/.local/state."""
    base = os.environ.get("XDG_STATE_HOME")
    try:
        return (Path(base) if base else Path.home() / ".local" / "state") / "panoptic_ros"
    except RuntimeError:  # a user without a home folder, as in containers
        return Path(tempfile.gettempdir()) / f"panoptic_ros-state-{os.getuid()}"


def cache_folder() -> Path:
    """Return the cache folder of models.

    PANOPTIC_CACHE, else XDG_CACHE_HOME/panoptic_ros, else ~/.cache/panoptic_ros.
    """
    own = os.environ.get("PANOPTIC_CACHE")
    if own:
        return Path(own)
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "panoptic_ros"
