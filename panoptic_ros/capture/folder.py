"""Open capture folders: a rig and one video or folder of images per camera, checked against each other."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from panoptic_ros.capture.at_once import opened_at_once
from panoptic_ros.capture.depth_folder import DepthSource, depth_files
from panoptic_ros.capture.depth_sensor import DepthSensorSource, open_depth_sensors
from panoptic_ros.capture.image_folder import ImageFolderSource
from panoptic_ros.capture.image_size import SizePolicy, fit_camera, size_change
from panoptic_ros.capture.layout import check_cameras, find_media, named_as
from panoptic_ros.capture.sound import SOUND_NAMES, folder_sounds, sound_files, track_sound
from panoptic_ros.capture.source import FrameSource, exact_rate, grid_stamp
from panoptic_ros.capture.starts import find_starts
from panoptic_ros.capture.synctables import table_files, table_times, tabled_notices
from panoptic_ros.capture.timed import CorrectedSource, TimedSource
from panoptic_ros.capture.video import VideoSource
from panoptic_ros.domain import Rig
from panoptic_ros.domain.rig import lines_of
from panoptic_ros.errors import DataError
from panoptic_ros.io.occluders import FILE as OCCLUDERS
from panoptic_ros.io.occluders import read_occluders
from panoptic_ros.io.rigs import find_rig, read_rig
from panoptic_ros.io.stamps import StampTable, read_stamps, stamp_file, stamps_of_frames

NO_TIMES: Mapping[str, Mapping[int, int]] = {}
NO_CORRECTIONS: Mapping[str, Mapping[str, Any]] = {}
IMAGE_RATE = 30.0  # Hz, assumed for images without timestamps: the rate of most cameras
NO_RATE = f"{IMAGE_RATE:g} Hz is assumed, as images state no rate; --frame-rate or timestamps.csv states it"


@dataclass(frozen=True)
class CaptureFolder:
    """Recorded capture with open sources; a context manager that closes them.

    Args:
        path: The folder, or the common parent of the files.
        rig: The cameras that have images, with the images' sizes.
        sources: One per camera, in the order of the rig.
        notices: One line about each adaptation or omission.
        depth_sensors: One per depth sensor of the rig that has maps, in the order of the rig.
        sounds: Descriptions of the audio recordings, for `capture.sound.open_sound`.
        stamps: Timestamps (ns) by camera, if the folder has its own.
        starts: See `open_files`.
    """

    path: Path
    rig: Rig
    sources: tuple[FrameSource, ...]
    notices: tuple[str, ...] = ()
    depth_sensors: tuple[DepthSensorSource, ...] = ()
    sounds: tuple[Mapping[str, Any], ...] = ()
    stamps: Mapping[str, Sequence[int]] = field(default_factory=dict)
    starts: Mapping[str, int] = field(default_factory=dict)

    @property
    def depth_cameras(self) -> tuple[str, ...]:
        """Return the names of the cameras with depth maps registered to their images."""
        return tuple(source.camera for source in self.sources if isinstance(source, DepthSource))

    @property
    def frame_count(self) -> int | None:
        """Return the number of frames of all cameras together; None if a source does not know its own."""
        counts = [source.frame_count for source in self.sources]
        return None if None in counts else sum(count for count in counts if count is not None)

    def close(self) -> None:
        """Close all sources."""
        for source in self.sources:
            source.close()

    def __enter__(self) -> CaptureFolder:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


def open_capture_folder(
    path: Path,
    *,
    rig: Rig | None = None,
    cameras: Sequence[str] | None = None,
    size_policy: SizePolicy = "strict",
    start_ns: int = 0,
    frame_rate: float | None = None,
    corrections: Mapping[str, Mapping[str, Any]] = NO_CORRECTIONS,
    starts: Mapping[str, int] | None = None,
    hardware: str = "",
    depth: bool = True,
    skip_damaged: bool = False,
    until_ns: int | None = None,
) -> CaptureFolder:
    """Open a capture folder.

    Args:
        path: Holds a rig file and `<camera>.mp4` (or .avi .mkv .mov ...) or `<camera>/*.png|jpg` per camera.
            Optional depth maps are `<camera>_depth/*.png` (see `DepthSource`) and `<sensor>_depth/*.png` of
            the rig's depth sensors (see `DepthSensorSource`). Optional audio is `<device>.wav` or sound
            tracks, with sound.yaml (see `folder_sounds`). Further optional files are occluders.json, and
            timestamps.csv or else CMU's sync tables (see `table_times`). Other files and folders are ignored.
        rig: Replaces the rig file and occluders.json.
        cameras: Use only these.
        size_policy: See `fit_camera`.
        start_ns, frame_rate: See `VideoSource`. Image folders without timestamps have 30 Hz by default.
        corrections: Timestamp corrections by camera, see `CorrectedSource`; audio keeps its own timestamps.
        starts: See `open_files`.
        hardware, skip_damaged: See `Movie`.
        depth: Use depth maps that are registered to cameras.
        until_ns: Frames with this timestamp and later ones are skipped.

    Raises:
        DataError: if the folder, the rig or a camera's images are missing, or a camera has two files.
        UsageError: if there are several rigs.
        CalibrationError: if a video has no camera in the rig, or an image size differs from the rig's.
    """
    path = Path(path)
    if not path.is_dir():
        raise DataError(f"capture folder {path} " + ("is a file" if path.exists() else "does not exist"))
    if rig is None:
        rig = read_rig(find_rig(path), cameras=cameras)
        if (path / OCCLUDERS).is_file():
            rig = replace(rig, occluders=read_occluders(path / OCCLUDERS))
    media = find_media(path, rig)
    rig = media.rig if cameras is None else rig.subset(cameras)
    check_cameras(path, media, rig.names, cameras is None)
    files = {name: media.files[name] for name in rig.names}
    stamps, times = folder_stamps(path, files, (*rig.names, *(sensor.name for sensor in rig.depth_sensors)))
    by_studio = not stamps and not times and bool(table_files(path))
    times = table_times(path, rig) if by_studio else times
    opened = open_files(
        rig,
        files,
        size_policy=size_policy,
        start_ns=start_ns,
        frame_rate=frame_rate,
        stamps=stamps,
        times=times,
        corrections=corrections,
        starts=starts,
        hardware=hardware,
        depth=depth,
        skip_damaged=skip_damaged,
        until_ns=until_ns,
    )
    told = tabled_notices(rig) if by_studio else ()
    stamps = stamps or {name: tuple(own.values()) for name, own in times.items()}
    begins = {
        name: stamps[name][0] if name in stamps else start_ns + opened.starts.get(name, 0)
        for name in rig.names
    }
    tracks = {Path(sound["path"]).name: sound for sound in opened.sounds}
    videos = {**media.others, **{name: file for name, file in media.files.items() if file.is_file()}}
    others = _others(videos, rig, start_ns) if (path / SOUND_NAMES).exists() else {}
    try:
        sounds = folder_sounds(path, begins, others | tracks)
    except BaseException:
        opened.close()
        raise
    return replace(opened, sounds=sounds, stamps=stamps, notices=(*media.notices, *opened.notices, *told))


def open_files(
    rig: Rig,
    files: Mapping[str, Path],
    *,
    size_policy: SizePolicy = "strict",
    start_ns: int = 0,
    frame_rate: float | None = None,
    stamps: Mapping[str, Sequence[int]] | None = None,
    times: Mapping[str, Mapping[int, int]] = NO_TIMES,
    corrections: Mapping[str, Mapping[str, Any]] = NO_CORRECTIONS,
    starts: Mapping[str, int] | None = None,
    hardware: str = "",
    depth: bool = True,
    skip_damaged: bool = False,
    until_ns: int | None = None,
) -> CaptureFolder:
    """Open one video or image folder per camera with its depth maps, and check it against the rig.

    Args:
        files: Path by camera; the rig of the result omits cameras that have no path.
        stamps: Timestamps (ns) by camera, which replace the files' own times. If any are given, all cameras
            need them.
        times: The same by frame number; frames without one are skipped.
        corrections: Timestamp corrections by camera, see `CorrectedSource`.
        starts: Delay (ns) after `start_ns` at which a camera's recording began. None = the result of
            `find_starts`, if there are no timestamps.
        hardware, skip_damaged: See `Movie`.
        until_ns: See `open_capture_folder`.

    Raises:
        CalibrationError, DataError: as `open_capture_folder`.
    """
    chosen = rig.subset(files)
    notices = [f"camera {name} of the rig has no images" for name in rig.names if name not in files]
    tabled = stamps or times
    for name in chosen.names:
        if tabled and name not in tabled:
            there = ", ".join(sorted(tabled))
            raise DataError(f"timestamps.csv has stamps for {there} but none for camera {name}")
    sources: list[FrameSource] = []
    sounds: list[Mapping[str, Any]] = []
    said: dict[str, list[str]] = {}  # cameras by notice
    own_stamps = {name: stamps[name] if stamps else None for name in chosen.names}

    def open_one(name: str) -> VideoSource | ImageFolderSource:
        return _open(
            name,
            Path(files[name]),
            start_ns,
            frame_rate,
            own_stamps[name],
            hardware,
            skip_damaged,
            bool(times),
        )

    sources += (first := opened_at_once(open_one, chosen.names))
    try:
        told: tuple[str, ...] = ()
        if starts is None:
            starts, told = ({}, ()) if tabled else find_starts(first)
        for k, (name, images) in enumerate(zip(chosen.names, first)):
            images.start_ns += starts.get(name, 0)
            if isinstance(images, VideoSource) and images.has_sound:
                sounds.append(_sound(images, frame_rate, own_stamps[name]))
            own_time = TimedSource(images, times[name]) if name in times else images
            assumed = frame_rate is None and not tabled and isinstance(images, ImageFolderSource)
            for text in (
                *images.notices,
                *(own_time.notices if own_time is not images else ()),
                *((NO_RATE,) if assumed else ()),
            ):
                said.setdefault(text, []).append(name)
            changed = name in corrections or until_ns is not None
            timed = CorrectedSource(own_time, corrections.get(name), until_ns) if changed else own_time
            depths = depth_files(Path(files[name]).parent, name) if depth else ()
            sources[k] = DepthSource(timed, depths, images.frame_count) if depths else timed
        notices += [_told(text, names) for text, names in said.items()]
        fitted, changes = fit_rig(rig, sources, size_policy)
        parent = Path(files[chosen.names[0]]).parent
        sensors = open_depth_sensors(parent, chosen, start_ns=start_ns, frame_rate=frame_rate, stamps=stamps)
    except BaseException:
        for source in sources:
            source.close()
        raise
    mapped = {source.camera for source in sensors}
    for sensor in rig.depth_sensors:
        if sensor.name not in mapped:
            notices.append(f"depth sensor {sensor.name} of the rig has no maps")
    return CaptureFolder(
        parent,
        fitted,
        tuple(sources),
        (*notices, *told, *changes),
        sensors,
        tuple(sounds),
        stamps or {},
        starts,
    )


def fit_rig(
    rig: Rig, sources: Sequence[FrameSource], size_policy: SizePolicy = "strict"
) -> tuple[Rig, tuple[str, ...]]:
    """Return the rig with only the sources' cameras and image sizes, and lines about changes.

    Raises:
        CalibrationError: for a camera that the rig does not have, or whose size does not fit; see
            `fit_camera`.
    """
    by_name = {source.camera: source for source in sources}
    fitted, changes = [], []
    for camera in rig.subset(by_name).cameras:
        size = by_name[camera.name].image_size
        fitted.append(fit_camera(camera, size, size_policy))
        changes.append((camera.name, size_change(camera, size, size_policy)))
    return replace(rig, cameras=tuple(fitted)), lines_of(changes)


def _sound(video: VideoSource, frame_rate: float | None, stamps: Sequence[int] | None) -> dict[str, Any]:
    """Describe the sound of a video, with timestamps consistent with its frames."""
    if stamps is None and frame_rate is not None:
        rate = exact_rate(frame_rate, f"video {video.path}")
        stamps = [grid_stamp(video.start_ns, k, rate) for k in range(video.frame_count or 0)]
    return track_sound(video.path, video.camera, video.start_ns, stamps or (), track=video.sound_track)


def _others(videos: Mapping[str, Path], rig: Rig, start_ns: int) -> dict[str, dict[str, Any]]:
    """Describe the sound of videos of unused cameras: other recordings may be synchronised with it."""
    others = {path.name: name for name, path in videos.items() if name not in rig.names}
    return {file: track_sound(videos[name], name, start_ns) for file, name in others.items()}


def _open(
    camera: str,
    path: Path,
    start_ns: int,
    frame_rate: float | None,
    stamps: Sequence[int] | None,
    hardware: str,
    skip_damaged: bool,
    tabled: bool = False,
) -> VideoSource | ImageFolderSource:
    if path.is_dir():
        rate = IMAGE_RATE if frame_rate is None else frame_rate
        return ImageFolderSource(
            camera,
            path,
            start_ns=start_ns,
            frame_rate=rate,
            stamps=stamps,
            tabled=tabled,
            skip_damaged=skip_damaged,
        )
    return VideoSource(
        camera,
        path,
        start_ns=start_ns,
        frame_rate=frame_rate,
        stamps=stamps,
        hardware=hardware,
        skip_damaged=skip_damaged,
    )


def _told(text: str, cameras: Sequence[str]) -> str:
    """Return one line about cameras that share a notice."""
    return f"camera{'s' if len(cameras) > 1 else ''} {', '.join(cameras)}: {text}"


def folder_stamps(
    path: Path, files: Mapping[str, Path], names: Collection[str]
) -> tuple[dict[str, tuple[int, ...]], dict[str, dict[int, int]]]:
    """Read the timestamp table of a capture folder.

    Args:
        files: files of images; the table may lie beside them.
        names: names of cameras and sensors. Rows with other names keep them. Rows of `<device>.wav` are left
            out.

    Returns:
        timestamps (ns) of all frames by camera. If the table has gaps, this is empty, and the second value
        has the timestamps by camera and frame number.

    Raises:
        DataError: as `read_stamps`.
    """
    places = dict.fromkeys([path, *(file.parent for file in files.values())])
    table = next((found for place in places if (found := stamp_file(place)) is not None), None)
    if table is None:
        return {}, {}
    heard = {file.stem for file in sound_files(path)} - set(names)
    rows = {name: own for name, own in read_stamps(table).items() if name not in heard}
    meant = named_as(names, list(rows))
    rows = {meant.get(name, name): own for name, own in rows.items()}
    if any(_has_gaps(own) for own in rows.values()):
        return {}, {name: dict(zip(own.frames or (), own.stamps_ns)) for name, own in rows.items()}
    return stamps_of_frames(table, rows), {}


def starts_of_files(files: Mapping[str, Path]) -> dict[str, int]:
    """Find the starts of recordings, see `find_starts`; skip files that cannot be read."""
    sources = []
    for name, path in files.items():
        with suppress(DataError):
            sources.append(_open(name, path, 0, None, None, "", False))
    for source in sources:
        source.close()
    return find_starts(sources)[0]


def _has_gaps(table: StampTable) -> bool:
    """Return whether a device counted its frames, and some of them have no timestamp."""
    return table.numbers is not None and table.numbers != list(range(len(table.numbers)))
