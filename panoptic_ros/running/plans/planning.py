"""Makes plans of runs on images: a capture folder, single recordings, or devices. For bags see `bag_plan`.

Also checks by the clocks of the cameras that their recordings overlap in time.
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
from panoptic_ros.running.sound.use import SoundRecorder, plan_clocks
from panoptic_ros.timecode.config import TimecodeConfig

SECOND = 1_000_000_000
DAY_S = 86_400


def check_overlap(
    shifts: Mapping[str, int], stamps: Mapping[str, Sequence[int]], heard: Mapping[str, object]
) -> None:
    """Check that the recordings overlap in master time.

    Recordings that never overlap carry unrelated timecodes.

    Args:
        shifts: by camera: correction from its timestamps to master time, ns.
        stamps: timestamps of each camera's frames, ns, with the first and the last one.
        heard: recorders in use. Without any, the clocks are unknown, and nothing is checked.

    Raises:
        DataError: naming the cameras that belong together, and their times.
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
            f"by their timecode, the recordings never overlap: {said}. Different generators? Give a "
            "recording with the timecode of both and name them in sound.yaml, or leave cameras out "
            "(--cameras)"
        )


def _clock(stamp_ns: int) -> str:
    """Return a time of day as text."""
    seconds = stamp_ns / SECOND % DAY_S
    return f"{int(seconds // 3600):02d}:{int(seconds // 60 % 60):02d}:{seconds % 60:04.1f}"


NOTHING: Mapping[str, str] = {}


def plan_capture(
    folder: Path,
    options: RunOptions = NO_OPTIONS,
    *,
    rig: Path | Rig | None = None,
    cameras: Sequence[str] | None = None,
    frame_rate: float | None = None,
    size_policy: str = "strict",
    hardware: str = "",
    title: str = "",
    depth: bool = True,
    skip_damaged: bool = False,
) -> Plan:
    """Return the plan of a run on a capture folder.

    Args:
        rig: Calibration, or its file, that replaces the folder's own.
        cameras: Names of the cameras to use; None = all.
        frame_rate: Hz, replaces that of the files.
        size_policy: For images whose size differs from the calibration: strict, scale, letterbox or crop.
        hardware: FFmpeg's name of the hardware that decodes videos; "" = the processor.
        title: Name of the capture in the report; "" = its folder.
        depth: Use depth maps that are registered to cameras.
        skip_damaged: Leave out damaged frames, and count them.

    Raises:
        UserError: on any fault that the user can fix, before anything has started.
    """
    own: dict[str, Any] = {"size_policy": size_policy, "frame_rate": frame_rate, "hardware": hardware}
    own |= ({} if depth else {"depth": False}) | ({"skip_damaged": True} if skip_damaged else {})
    options = replace(options, subjects=subject_files(folder, options.subjects), imus=imu_file(folder))
    if folder.is_dir() and not has_media(folder):
        if hint := hint_without_images(folder):
            raise DataError(f"{folder} has no videos and no images{hint}")
        if options.imus is not None and options.subjects:
            return plan_imu_file(title or str(folder), options)
    given = read_rig_at(rig, cameras=cameras) if isinstance(rig, Path) else rig
    with closing(open_capture_folder(folder, rig=given, cameras=cameras, **own)) as capture:
        source = {"kind": "folder", "path": str(folder), **own, **_starts(capture)}
        sources = dict.fromkeys(capture.rig.names, source)
        return _recorded(title or str(folder), capture, sources, options)


def plan_demo(name: str = "multi", options: RunOptions = NO_OPTIONS, **capture_options: Any) -> Plan:
    """Return the plan of a run on the demo capture of that name. Further options: see `plan_capture`."""
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
    """Return the plan of a run on videos or folders of images.

    Args:
        rig: calibration file.
        files: video or folder of each camera.
        frame_rate: Hz, replaces that of the files.
        size_policy, hardware, skip_damaged: as for `plan_capture`.

    Raises:
        UserError: on any fault that the user can fix, before anything has started.
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
    """Return the plan of a live run on camera devices.

    Args:
        rig: calibration file.
        devices: V4L2 device or RTSP/HTTP address of each camera.
        microphones: PortAudio input, or a WAV file to play, by name. This machine's clock timestamps both
            microphones and cameras. So the first microphone stands for the clock of cameras without one.
        frame_rate: Hz to request; default 30.
        latency_ms: latency of the devices from exposure to arrival, ms.

    Raises:
        UserError: on any fault that the user can fix, before anything has started.
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
    heard = plan_clocks(clocked, plan.configs, [SoundRecorder(name, (), name) for name in microphones], {})
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
    """Return the rig, with the first microphone as the clock of all cameras without a clock."""
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
    """Return the plan with timestamps that are corrected from the sound that several cameras recorded.

    Raises:
        UsageError: if the sound carries timecode, which is more accurate, or offsets are given as well.
        DataError: if no two cameras have sound.
    """
    lines, told = corrections_from_sound(recorders_of(capture.sounds), plan.rig, options)
    sources = {
        name: {**source, "corrections": {name: lines[name].words()}} if name in lines else source
        for name, source in plan.sources.items()
    }
    return replace(plan, sources=sources, notices=(*plan.notices, *told))


def _with_sound(plan: Plan, capture: CaptureFolder) -> Plan:
    """Return the plan with the sound that carries the timecode of the cameras' clocks."""
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
    """Return the given shifts, from the clocks, plus the shifts of the plan, from known offsets."""
    return {name: plan.shifts.get(name, 0) + shifts.get(name, 0) for name in (*plan.shifts, *shifts)}


def _starts(capture: CaptureFolder) -> dict[str, Any]:
    """Return the start times of all cameras for their descriptions; empty if the cameras started together."""
    return {"starts": dict(capture.starts)} if capture.starts else {}


def _counted(source: FrameSource, start_ns: int) -> list[int]:
    """Return timestamps, ns, of the first three frames and the last frame, computed from the frame rate."""
    frames = range(source.frame_count or 3)
    return [start_ns + round(k * 1e9 / source.frame_rate) for k in dict.fromkeys([*frames[:3], *frames[-1:]])]
