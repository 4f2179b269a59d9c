"""Converts takes of public data sets into capture folders with truth. Videos are linked, not copied."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from panoptic_ros.domain import Rig
from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.io.body_files import write_bodies
from panoptic_ros.io.body_models import read_body_model
from panoptic_ros.io.datasets import human36m, total_capture
from panoptic_ros.io.files import write_bytes, write_json
from panoptic_ros.io.folders import staged_folder
from panoptic_ros.io.kinematic_files import subject_document, write_imus
from panoptic_ros.io.plain_formats import SKELETONS
from panoptic_ros.io.rigs import read_rig, write_rig

Array = np.ndarray
VIDEOS = (".mp4", ".avi", ".mkv", ".mov")
LONGER = 2  # maximum length of a video, in multiples of the length of the truth


def import_total_capture(folder: Path, take: str, out: Path) -> list[str]:
    """Convert a take of Total Capture, e.g. "s1/acting1", into a capture folder.

    The folder gets the rig, IMU samples, the subject, the truth and links to the videos.

    Returns:
        lines about the take.

    Raises:
        UserError: if a file is missing, exists twice or is invalid.
    """
    subject, action = _split(take)
    files = _FileIndex(folder, subject)
    both = (action, f"{subject}_{action}")
    sensors = [f"{name}_xsens{end}.sensors" for end in ("_auxfields", "") for name in both]
    calibration = [f"{subject}_{action}_calib_imu_{kind}.txt" for kind in ("bone", "ref")]
    model, notices = read_body_model(), list[str]()
    places, turns = (files.one(f"gt_skel_gbl_{kind}.txt", inside=action) for kind in ("pos", "ori"))
    truth, axes = total_capture.read_truth(places, turns, model)
    person = total_capture.read_subject(files.one(calibration[0]), truth, axes, model)
    devices = total_capture.read_imus(files.one(*sensors), files.one(calibration[1]), notices)
    devices, truth = total_capture.placed_in_time(person, devices, truth, notices)
    rig = read_rig(files.one("calibration.cal", anybody=True))
    videos = {name: files.video(f"tc_{subject}_{action}_{name}") for name in rig.names}
    with staged_folder(out) as staged:
        write_rig(staged / "rig.json", rig)
        write_imus(staged / "imu.csv.gz", devices)
        write_json(staged / "subject.json", subject_document(person), indent=1)
        write_bodies(staged / "truth.json.gz", model, truth)
        linked = _link(staged, videos, total_capture.RATE, len(truth))
    seconds = len(truth) / total_capture.RATE
    seen = _seen(rig, np.array([state.places[0] for state in truth]))
    off = total_capture.degrees_off(person, devices, truth)
    worst, middle = max(off, key=lambda name: off[name]), float(np.median(list(off.values())))
    return [
        *notices,
        *person.told(),
        f"assumed from the description of the data set, not from its files: {total_capture.RATE:g} "
        f"frames/s, inches, y up; height {person.stature:.2f} m from the bones",
        f"{out}: {seconds:.1f} s, {len(rig)} cameras, {linked} videos, {len(devices)} IMUs",
        f"check of consistency: {seen}; IMUs with their mountings are {middle:.1f} deg off the true "
        f"segments (median; most {off[worst]:.1f}, {worst})",
    ]


def import_human36m(folder: Path, take: str, out: Path) -> list[str]:
    """Convert a take of Human3.6M, e.g. "S9/Walking 1", into a capture folder.

    The folder gets the rig, the true joints and links to the videos.

    Returns:
        lines about the take.

    Raises:
        UserError: if a file is missing, exists twice or is invalid.
    """
    subject, action = _split(take)
    number = re.fullmatch(r"s(\d+)", subject)
    if number is None:
        raise UsageError(f"--take {take!r}: subjects of Human3.6M are S1 to S{human36m.SUBJECTS}")
    files = _FileIndex(folder, subject)
    joints = human36m.read_joints(files.one(f"{action}.cdf", inside="d3_positions"))
    rig = human36m.read_cameras(files.one("metadata.xml", anybody=True), int(number[1]))
    frames = [
        {
            "index": t,
            "stamp_ns": round(1e9 * t / human36m.RATE),
            "skeletons": [{"id": 0, "joints": np.round(places, 5).tolist()}],
        }
        for t, places in enumerate(joints)
    ]
    videos = {name: files.video(f"{action}.{name}") for name in rig.names}
    with staged_folder(out) as staged:
        write_rig(staged / "rig.json", rig)
        write_json(
            staged / "truth.json.gz",
            {"format": SKELETONS, "joint_names": list(human36m.NAMED), "frames": frames},
        )
        linked = _link(staged, videos, human36m.RATE, len(joints))
    return [
        f"assumed from the description of the data set, not from its files: {human36m.RATE:g} frames/s, "
        "millimetres, z up",
        f"{out}: {len(joints) / human36m.RATE:.1f} s, {len(rig)} cameras, {linked} videos",
        f"check of consistency: {_seen(rig, joints[:, 0])}",
    ]


def _seen(rig: Rig, places: Array) -> str:
    """Return a line with the number of cameras that see the true pelvis in most frames.

    The number is 0 if rig and truth differ in world frame or unit.

    Args:
        places: (T, 3) m, positions of the pelvis.
    """
    count = sum(bool(camera.sees(places).mean() > 0.5) for camera in rig.cameras)
    return f"the true pelvis is in the images of {count} of {len(rig)} cameras"


def _split(take: str) -> tuple[str, str]:
    subject, _, action = take.lower().partition("/")
    if not subject or not action:
        raise UsageError(f"--take {take!r} is not SUBJECT/TAKE, e.g. s1/acting1")
    return subject, action


class _FileIndex:
    """Index of all files below a folder by name.

    It ignores case and depth, as archives are unpacked in many ways.

    Args:
        subject: name in the paths of the subject's files, delimited by slashes or underscores.
    """

    def __init__(self, folder: Path, subject: str):
        if not folder.is_dir():
            raise DataError(f"{folder} is not a folder")
        self._folder = folder
        self._whose = re.compile(rf"(^|[/_]){re.escape(subject)}([/_]|$)")
        self._all = sorted(path for path in folder.rglob("*") if path.is_file())

    def one(self, *names: str, inside: str = "", anybody: bool = False) -> Path:
        """Return the file with the first of these names that exists.

        Args:
            inside: name of the folder that contains it; "" = any folder.
            anybody: accept files of other subjects, too.

        Raises:
            UsageError: if several files have that name.
            DataError: if no file has one of these names.
        """
        for name in names:
            found = [path for path in self._named(name, anybody) if inside in ("", path.parent.name.lower())]
            if len(found) > 1:
                raise UsageError(f"{found[0]} and {found[1]} both match; name a folder with one")
            if found:
                return found[0]
        where = f" in a folder {inside}" if inside else ""
        raise DataError(
            f"{self._folder} has no {' or '.join(names)}{where} of the take, in upper or lower case"
        )

    def video(self, stem: str) -> Path | None:
        """Return the video of this name, or None."""
        found = [path for end in VIDEOS for path in self._named(stem + end, anybody=False)]
        return found[0] if found else None

    def _named(self, name: str, anybody: bool) -> list[Path]:
        return [
            path
            for path in self._all
            if path.name.lower() == name
            and (anybody or self._whose.search(path.relative_to(self._folder).as_posix().lower()))
        ]


def _link(folder: Path, videos: dict[str, Path | None], rate: float, count: int) -> int:
    """Link the videos under their cameras' names, write timestamps.csv, and return the number of videos.

    Data sets count frames. So frame n gets the timestamp n / rate, whatever the video file states.

    Args:
        rate: frame rate of the truth, Hz.
        count: number of frames of the truth. A video may be up to `LONGER` times as long.
    """
    there = {name: path for name, path in videos.items() if path is not None}
    for name, path in there.items():
        (folder / f"{name}{path.suffix.lower()}").symlink_to(path.resolve())
    if there:
        stamps = [round(1e9 * k / rate) for k in range(LONGER * count)]
        rows = [f"{name},{k},{stamp}\n" for name in there for k, stamp in enumerate(stamps)]
        write_bytes(folder / "timestamps.csv", ("camera,frame,stamp_ns\n" + "".join(rows)).encode())
    return len(there)
