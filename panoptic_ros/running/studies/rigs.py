"""Studies of rigs: from a file of cameras to numbers and a plot."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from panoptic_ros.bench.studies.takes import Method, Takes
from panoptic_ros.domain import Rig
from panoptic_ros.errors import UsageError
from panoptic_ros.graph.build import merged
from panoptic_ros.io.files import write_json
from panoptic_ros.io.rigs import read_rig
from panoptic_ros.running.plans.parameters import Parameters
from panoptic_ros.running.plans.presets import NO_PRESET, Preset
from panoptic_ros.stage import Progress

STUDIES = ("cameras", "nodes", "resolution", "time")
MODEL = "movenet-multipose"


@dataclass(frozen=True)
class StudyRequest:
    """What is asked for.

    Args:
        name: one of `STUDIES`. rig: file of the cameras.
        cameras: numbers of cameras; nodes, time: all, resolution: the first.
        settings: parameters of voting and assembly, for every method.
        preset: what is put beside the default; `NO_PRESET` = nothing.
    """

    name: str
    rig: Path
    takes: Takes
    cameras: tuple[int, ...]
    settings: Parameters
    preset: Preset = NO_PRESET

    @property
    def methods(self) -> tuple[Method, ...]:
        """The default, and the preset beside it."""
        default = Method(settings=self.settings)
        if self.preset is NO_PRESET:
            return (default,)
        settings = merged(self.preset.parameters, self.settings)
        return default, Method(self.preset.name, settings, self.preset.skeleton)


def run_study(request: StudyRequest, progress: Progress) -> dict[str, Any]:
    """The numbers of a study, for JSON.

    Raises:
        UserError: if the cameras or the detector cannot be loaded.
    """
    run = {"resolution": _resolution, "time": _time}.get(request.name, _cameras)
    return run(request, progress)


def write_study(folder: Path, result: dict[str, Any]) -> list[Path]:
    """Write NAME.json and, of accuracy, NAME.png; their paths."""
    from panoptic_ros.view.study_plots import write_study_plot  # matplotlib is slow to load

    path = folder / f"{result['study']}.json"
    write_json(path, result)
    if result["study"] == "time":
        return [path]
    what = (
        "rendered images, default detector"
        if result["study"] == "resolution"
        else (f"simulated detector, noise {100 * result['noise_share']:g} % of the person's size")
    )
    picture = path.with_suffix(".png")
    write_study_plot(picture, result["rows"], f"PCK, {what}")
    return [path, picture]


def _cameras(request: StudyRequest, progress: Progress) -> dict[str, Any]:
    from panoptic_ros.bench.studies.cameras import study_cameras

    rig = _of_type(request.rig, "vga")
    counts = (len(rig),) if request.name == "nodes" else request.cameras
    result = study_cameras(rig, request.takes, counts, request.methods, progress)
    return result | {"study": request.name}


def _resolution(request: StudyRequest, progress: Progress) -> dict[str, Any]:
    from panoptic_ros.bench.studies.resolution import study_resolution

    hd, vga = read_rig(request.rig, types=("hd",)), read_rig(request.rig, types=("vga",))
    return study_resolution((hd, vga), request.cameras[0], request.takes, request.methods, MODEL, progress)


def _time(request: StudyRequest, progress: Progress) -> dict[str, Any]:
    from panoptic_ros.bench.studies.times import study_time

    rig = _of_type(request.rig, "vga")
    return study_time(rig, request.takes, request.methods, MODEL, progress)


def _of_type(path: Path, kind: str) -> Rig:
    """The cameras of a type, for files that know types; else all."""
    try:
        return read_rig(path, types=(kind,))
    except UsageError:
        return read_rig(path)
