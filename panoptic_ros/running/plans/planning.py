"""Plans of runs on images: a capture folder, single recordings, or devices. For bags see `bag_plan`.

Whether the cameras of a recording saw anything at the same time, by what their clocks say.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

from panoptic_ros.capture import (
    CaptureFolder,
    FrameSource,
    demo_capture,
    has_media,
    open_capture_folder,
    open_files,
)
from panoptic_ros.capture.imus import imu_file
from panoptic_ros.capture.sound import described_sound
from panoptic_ros.domain import Rig
from panoptic_ros.errors import DataError
from panoptic_ros.graph.build import configure
from panoptic_ros.io.rigs import read_rig
from panoptic_ros.params import config_of, named_words
from panoptic_ros.patches.config import PatchesConfig
from panoptic_ros.running.plans.designated import subject_files
from panoptic_ros.running.plans.imu_plan import hint_without_images, plan_imu_file
from panoptic_ros.running.plans.options import NO_OPTIONS, RunOptions
from panoptic_ros.running.plans.parameters import live_parameters, with_defaults
from panoptic_ros.running.plans.plan import Plan, require_cameras
from panoptic_ros.running.plans.rig_files import read_rig_at
from panoptic_ros.running.sound.clocks import corrections_from_sound, recorders_of
from panoptic_ros.running.sound.tracks import find_tracks
from panoptic_ros.running.sound.use import Recorder, plan_clocks
from panoptic_ros.timecode.config import TimecodeConfig

SECOND = 1_000_000_000
DAY_S = 86_400


def check_overlap(
    shifts: Mapping[str, int], stamps: Mapping[str, Sequence[int]], heard: Mapping[str, object]
) -> None:
    """Recordings that never overlap hear timecodes that have nothing to do with each other.

    Args:
        shifts: of cameras, from their stamps to master time, ns.
        stamps: of each camera's frames, the first and the last among them, ns.
        heard: the sound that is used; without any nothing is known of the clocks.

    Raises:
        DataError: naming the cameras that belong together, and when.
    """
    if not heard:
        return
    spans = sorted(
        (own[0] + shifts.get(name, 0), own[-1] + shifts.get(name, 0), name) for name, own in stamps.items()
    )
    groups: list[list[tuple[int, int, str]]] = []
    for span in spans:
        if groups and span[0] <= max(end for _, end, _ in groups[-1]):
            groups[-1].append(span)
        else:
            groups.append([span])
    if len(groups) > 1:
        said = "; ".join(
            f"{', '.join(sorted(name for _, _, name in group))} from {_clock(group[0][0])} to "
            f"{_clock(max(end for _, end, _ in group))}"
            for group in groups
        )
        raise DataError(
            f"by the timecode that they hear, the recordings never overlap: {said}. Different "
            "generators? Give a recording that hears both and name them in sound.yaml, or leave cameras "
            "out (--cameras)"
        )


def _clock(stamp_ns: int) -> str:
    """A time of the day."""
    seconds = stamp_ns / SECOND % DAY_S
    return f"{int(seconds // 3600):02d}:{int(seconds // 60 % 60):02d}:{seconds % 60:04.1f}"


NOTHING: Mapping[str, str] = {}


def plan_capture(
    folder: Path,
    options: RunOptions = NO_OPTIONS,
    *,
    rig: Path | None = None,
    cameras: Sequence[str] | None = None,
    frame_rate: float | None = None,
    size_policy: str = "strict",
    hardware: str = "",
    title: str = "",
    depth: bool = True,
    skip_damaged: bool = False,
) -> Plan:
    """The plan of a run on a capture folder.

    Args:
        rig: calibration file, in place of the folder's own.
        cameras: use only these.
        frame_rate: Hz, in place of the files' own.
        size_policy: for images of another size than calibrated: strict, scale, letterbox or crop.
        hardware: that decodes videos, as FFmpeg calls it; "" = the processor.
        title: how the report calls the capture; its folder unless given.
        depth: use depth maps that are registered to cameras.
        skip_damaged: leave out frames that are damaged, and count them.

    Raises:
        UserError: on whatever the user can mend, before anything has started.
    """
    own: dict[str, Any] = {"size_policy": size_policy, "frame_rate": frame_rate, "hardware": hardware}
    own |= ({} if depth else {"depth": False}) | ({"skip_damaged": True} if skip_damaged else {})
    options = replace(options, subjects=subject_files(folder, options.subjects), imus=imu_file(folder))
    if folder.is_dir() and not has_media(folder):
        if hint := hint_without_images(folder):
            raise DataError(f"{folder} has no videos and no images{hint}")
        if options.imus is not None and options.subjects:
            return plan_imu_file(title or str(folder), options)
    given = None if rig is None else read_rig_at(rig, cameras=cameras)
    with closing(open_capture_folder(folder, rig=given, cameras=cameras, **own)) as capture:
        source = {"kind": "folder", "path": str(folder), **own, **_starts(capture)}
        sources = dict.fromkeys(capture.rig.names, source)
        return _recorded(title or str(folder), capture, sources, options)


def plan_demo(name: str = "multi", options: RunOptions = NO_OPTIONS, **capture_options: Any) -> Plan:
    """The plan of a run on the demo capture of that name; the rest as for `plan_capture`."""
    return plan_capture(demo_capture(name), options, title=f"demo capture {name}", **capture_options)


def plan_videos(
    rig: Path,
    files: Mapping[str, Path],
    options: RunOptions = NO_OPTIONS,
    *,
    frame_rate: float | None = None,
    size_policy: str = "strict",
    hardware: str = "",
    skip_damaged: bool = False,
) -> Plan:
    """The plan of a run on videos or folders of images.

    Args:
        rig: calibration file.
        files: of each camera.
        frame_rate: Hz, in place of the files' own.
        size_policy, hardware, skip_damaged: as for `plan_capture`.

    Raises:
        UserError: on whatever the user can mend, before anything has started.
    """
    own: dict[str, Any] = {"size_policy": size_policy, "frame_rate": frame_rate, "hardware": hardware}
    own |= {"skip_damaged": True} if skip_damaged else {}
    with closing(open_files(read_rig(rig), files, **own)) as capture:
        own |= _starts(capture)
        sources = {name: {"kind": "file", "path": str(path), **own} for name, path in files.items()}
        return _recorded("videos", capture, sources, options)


def plan_devices(
    rig: Path,
    devices: Mapping[str, str],
    options: RunOptions = NO_OPTIONS,
    *,
    frame_rate: float | None = None,
    latency_ms: float = 0.0,
    microphones: Mapping[str, str] = NOTHING,
) -> Plan:
    """The plan of a live run.

    Args:
        rig: calibration file.
        devices: V4L2 device or RTSP/HTTP address of each camera.
        microphones: input as PortAudio calls it, or a WAV file that is played, by name. They and the cameras
            are stamped by this machine's clock, so the first stands for that of cameras without a clock.
        frame_rate: Hz to ask for, 30 unless given.
        latency_ms: of the devices, from exposure to arrival.

    Raises:
        UserError: on whatever the user can mend, before anything has started.
    """
    skeleton, extras = options.detector()
    chosen = read_rig(rig, cameras=tuple(devices))
    require_cameras(chosen, bool(options.subjects))
    rate = frame_rate or 30.0
    own = {"frame_rate": frame_rate, "latency_ms": latency_ms}
    clocked = _on_first(microphones, chosen)
    plan = options.complete(
        Plan(
            "cameras",
            clocked,
            skeleton,
            with_defaults(options.all_parameters(), live_parameters(rate, len(devices))),
            {name: {"kind": "device", "device": device, **own} for name, device in devices.items()},
            extras=extras,
            frame_rate=rate,
            live=True,
        )
    )
    heard = plan_clocks(clocked, plan.configs, [Recorder(name, (), name) for name in microphones], {})
    named = named_words("TimecodeConfig.channels", config_of(plan.configs, TimecodeConfig).channels)
    sounds = [
        described_sound("microphone", name, _split(named.get(name)), address=address)
        for name, address in microphones.items()
        if name in heard.recorders
    ]
    return replace(plan, configs=heard.configs, sounds=tuple(sounds), notices=(*plan.notices, *heard.notices))


def _split(clocks: str | None) -> list[str]:
    return [] if clocks is None else [clock.strip() for clock in clocks.split(",")]


def _on_first(microphones: Mapping[str, str], rig: Rig) -> Rig:
    """The rig whose cameras without a clock have that of the first microphone."""
    first = next(iter(microphones), "")
    return replace(rig, cameras=tuple(replace(c, clock=c.clock or first) for c in rig.cameras))


def _recorded(
    title: str, capture: CaptureFolder, sources: Mapping[str, Mapping[str, Any]], options: RunOptions
) -> Plan:
    require_cameras(capture.rig, bool(options.subjects))
    skeleton, extras = options.detector()
    counts = [source.frame_count for source in capture.sources]
    instants = None if None in counts else max(count for count in counts if count is not None)
    configs = configure(options.all_parameters())
    maps = capture.depth_sensors if config_of(configs, PatchesConfig).active else ()
    plan = options.complete(
        Plan(
            title,
            capture.rig,
            skeleton,
            configs,
            sources,
            extras=extras,
            depth_cameras=capture.depth_cameras,
            maps=maps,
            frame_count=capture.frame_count,
            instants=instants,
            frame_rate=max(source.frame_rate for source in capture.sources),
            notices=capture.notices,
        )
    )
    return _by_sound(plan, capture, options) if options.from_sound else _with_sound(plan, capture)


def _by_sound(plan: Plan, capture: CaptureFolder, options: RunOptions) -> Plan:
    """The plan with stamps corrected by what cameras hear of each other's rooms.

    Raises:
        UsageError: if the sound carries timecode, which tells more, or offsets are given besides.
        DataError: if no two cameras have sound.
    """
    lines, told = corrections_from_sound(recorders_of(capture.sounds), plan.rig, options)
    sources = {
        name: {**source, "corrections": {name: lines[name].words()}} if name in lines else source
        for name, source in plan.sources.items()
    }
    return replace(plan, sources=sources, notices=(*plan.notices, *told))


def _with_sound(plan: Plan, capture: CaptureFolder) -> Plan:
    """The plan with what devices heard of the clocks of cameras."""
    named = named_words("TimecodeConfig.channels", config_of(plan.configs, TimecodeConfig).channels)
    given = [
        {**sound, "clocks": _split(named.get(sound["device"])) or sound["clocks"]} for sound in capture.sounds
    ]
    tracks = find_tracks(plan.rig, given, capture.stamps, plan.configs)
    recorders = recorders_of(tracks.sounds)
    stamps = {
        source.camera: capture.stamps.get(source.camera)
        or _counted(source, capture.starts.get(source.camera, 0))
        for source in capture.sources
    }
    clocks = plan_clocks(tracks.rig, plan.configs, recorders, stamps)
    check_overlap(clocks.shifts, stamps, clocks.recorders)
    sounds = [
        {**sound, "from_sample": clocks.recorders[sound["device"]]}
        for sound in tracks.sounds
        if sound["device"] in clocks.recorders
    ]
    return replace(
        plan,
        rig=tracks.rig,
        configs=clocks.configs,
        sounds=tuple(sounds),
        shifts=_sum(plan, clocks.shifts),
        notices=(*plan.notices, *tracks.notices, *clocks.notices),
    )


def _sum(plan: Plan, shifts: Mapping[str, int]) -> dict[str, int]:
    """Shifts by the clocks on top of those by offsets that are known."""
    return {name: plan.shifts.get(name, 0) + shifts.get(name, 0) for name in (*plan.shifts, *shifts)}


def _starts(capture: CaptureFolder) -> dict[str, Any]:
    """Return the starts of all cameras for their descriptions, where they did not begin together."""
    return {"starts": dict(capture.starts)} if capture.starts else {}


def _counted(source: FrameSource, start_ns: int) -> list[int]:
    """Stamps of the first frames and of the last one, by the frame rate."""
    frames = range(source.frame_count or 3)
    return [start_ns + round(k * 1e9 / source.frame_rate) for k in dict.fromkeys([*frames[:3], *frames[-1:]])]
