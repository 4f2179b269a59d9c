"""Checks of `panoptic doctor` that need no ROS: Python, packages, models, video, disk, cameras.

What a check is about is imported inside of it, so that its absence is a finding.
"""

from __future__ import annotations

import importlib.metadata
import os
import platform
import shutil
import sys
import tempfile
from pathlib import Path

from panoptic_ros.errors import UserError
from panoptic_ros.io.resources import cache_folder
from panoptic_ros.io.takes import OPEN, UnclosedTake, unclosed_take, unclosed_takes
from panoptic_ros.running.doctor.finding import Check, Finding, fail, ok, warn

SUPPORTED = ((3, 10), (3, 13))  # first and last minor version of Python
PACKAGES = ("numpy", "scipy", "onnxruntime", "onnx", "rosbags", "PyYAML", "numba", "matplotlib")
LITTLE_SPACE, NO_SPACE = 2.0, 0.3  # GB, for recordings and the download of a model


def check_python() -> Finding:
    """Version and platform."""
    first, last = (".".join(map(str, version)) for version in SUPPORTED)
    place = "a virtual environment" if sys.prefix != sys.base_prefix else "no virtual environment"
    found = f"{platform.python_version()} on {platform.system()} {platform.machine()}, {place}"
    if not SUPPORTED[0] <= sys.version_info[:2] <= SUPPORTED[1]:
        return fail(found, f"use Python {first} to {last}")
    if (platform.system(), platform.machine()) != ("Linux", "x86_64"):
        return warn(found, "the ROS wheels are for Linux on x86_64; elsewhere build with colcon in Jazzy")
    return ok(found)


def check_packages() -> Finding:
    """The Python packages that the program needs."""
    versions, missing = [], []
    for name in PACKAGES:
        try:
            versions.append(f"{name} {importlib.metadata.version(name)}")
        except importlib.metadata.PackageNotFoundError:
            missing.append(name)
    if missing:
        return fail(f"missing: {', '.join(missing)}", f"./run setup, or pip install {' '.join(missing)}")
    return ok(", ".join(versions))


def check_onnxruntime() -> Finding:
    """Execution providers for the networks."""
    from panoptic_ros.detection.backends.onnx import runtime_providers

    names = (name.removesuffix("ExecutionProvider") for name in runtime_providers())
    return ok(f"providers: {', '.join(names)}")


def check_model() -> Finding:
    """The default pose model."""
    from panoptic_ros.io.models import DEFAULT_MODEL, is_cached, read_card

    try:
        source = read_card(DEFAULT_MODEL)
        if is_cached(source):
            return ok(f"{DEFAULT_MODEL} in {source.model_path}")
    except UserError as error:
        return fail(str(error), "install the package again")
    return warn(f"{DEFAULT_MODEL} is not there yet", "panoptic models fetch")


def check_video() -> Finding:
    """Whether a video can be written and read back."""
    import av
    import numpy as np

    from panoptic_ros.capture import VideoSource
    from panoptic_ros.view.video_file import VideoFile, codec

    count, height, width = 5, 48, 64
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "check.mp4"
        with VideoFile(path, (width, height), 25.0) as video:
            for index in range(count):
                video.write(np.full((height, width, 3), 40 * index, np.uint8))
        with VideoSource("check", path) as source:
            levels = [float(frame.image.mean()) for frame in source]
    if len(levels) == count and np.allclose(levels, 40 * np.arange(count), atol=8):
        return ok(f"mp4 ({codec()}) written and read back")
    return fail(
        f"PyAV {av.__version__} read {len(levels)} of {count} frames of its own mp4",
        "python -m pip install --force-reinstall av",
    )


def check_disk() -> Finding:
    """Free space here, where results go, and in the cache."""
    places = {"here": Path.cwd(), "cache": _existing(cache_folder())}
    free = {name: shutil.disk_usage(path).free / 1e9 for name, path in places.items()}
    found = ", ".join(f"{name} {space:.1f} GB free" for name, space in free.items())
    if min(free.values()) < NO_SPACE:
        return fail(found, "make room: a recording and the download of a model need some 100 MB each")
    if min(free.values()) < LITTLE_SPACE:
        return warn(found, "make room before you record")
    return ok(found)


def check_cache() -> Finding:
    """Whether models can be kept."""
    folder = cache_folder()
    if _writable(_existing(folder)):
        return ok(f"{folder} is writable")
    return fail(f"no permission to write in {folder}", "set PANOPTIC_CACHE to a folder of your own")


def check_kernels() -> Finding:
    """Whether the files of compiled kernels are whole."""
    from panoptic_ros import kernels  # numba takes half a second to load

    folder = kernels.cache_folder()
    damaged = kernels.damaged_files(folder)
    if damaged:
        found = f"{len(damaged)} files of compiled kernels in {folder} are cut or damaged"
        return warn(f"{found}; each is compiled again when it is needed", "panoptic warm-up")
    return ok(f"compiled ones in {folder} are whole")


def check_takes() -> Finding:
    """Check for live takes that no process closed."""
    takes = {take.path.resolve(): take for take in (*unclosed_takes(), *_unclosed_here())}
    if not takes:
        return ok("no take that was not closed")
    found = "; ".join(str(take) for take in takes.values())
    return warn(found, f"panoptic bag repair {next(iter(takes.values())).path}")


def _unclosed_here() -> list[UnclosedTake]:
    """Return the same up to two levels below this folder, for takes of other users and other machines."""
    marks = (mark for depth in ("*", "*/*") for mark in Path.cwd().glob(f"{depth}/{OPEN}"))
    return [take for mark in marks if (take := unclosed_take(mark.parent)) is not None]


def check_cameras() -> Finding:
    """Video devices and whether this user may open them."""
    devices = sorted(Path("/dev").glob("video*"))
    closed = [str(device) for device in devices if not os.access(device, os.R_OK | os.W_OK)]
    if closed:
        return warn(f"no permission for {', '.join(closed)}", "join the group video and log in again")
    return ok(f"devices: {', '.join(map(str, devices)) or 'none (files and streams work without)'}")


def _existing(path: Path) -> Path:
    """The folder itself or the nearest one above it that exists."""
    return next(place for place in (path, *path.resolve().parents) if place.exists())


def _writable(folder: Path) -> bool:
    try:
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


MACHINE_CHECKS: dict[str, Check] = {
    "python": check_python,
    "packages": check_packages,
    "onnxruntime": check_onnxruntime,
    "model": check_model,
    "video": check_video,
    "disk": check_disk,
    "cache": check_cache,
    "kernels": check_kernels,
    "takes": check_takes,
    "cameras": check_cameras,
}
