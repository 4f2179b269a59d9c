"""Studies of rigs: from a file of cameras to numbers and a plot."""
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from panoptic_ros.domain import Rig
from panoptic_ros.errors import UsageError
from panoptic_ros.io.files import write_json
from panoptic_ros.io.rigs import read_rig
from panoptic_ros.stage import Progress

STUDIES = ("cameras", "nodes", "resolution")
MODEL = "movenet-multipose"


@dataclass(frozen=True)
class StudyRequest:
    """What is asked for.

    Args:
        name: one of `STUDIES`. rig: file of the cameras.
        people: numbers of people. cameras: numbers of cameras; nodes: all, resolution: the first.
        frames: per number of people. seed: of the simulation.
        noise: of 2D joints, a share of the diagonal of a person's box.
        settings: parameters of voting and assembly.
    """

    name: str
    rig: Path
    people: tuple[int, ...]
    cameras: tuple[int, ...]
    frames: int
    seed: int
    noise: float
    settings: dict[str, dict[str, Any]]


def run_study(request: StudyRequest, progress: Progress) -> dict[str, Any]:
    """The numbers of a study, for JSON.

    Raises:
        UserError: if the cameras or the detector cannot be loaded.
    """
    return (_resolution if request.name == "resolution" else _cameras)(request, progress)


def write_study(folder: Path, result: dict[str, Any]) -> Path:
    """Write NAME.json and NAME.png; the path of the former."""
    from panoptic_ros.view.study_plots import write_study_plot  # matplotlib is slow to load

    path = folder / f"{result['study']}.json"
    write_json(path, result)
    what = "rendered images, default detector" if result["study"] == "resolution" else (
        f"simulated detector, noise {100 * result['noise_share']:g} % of the person's size"
    )
    write_study_plot(path.with_suffix(".png"), result["rows"], f"PCK, {what}")
    return path


def _cameras(request: StudyRequest, progress: Progress) -> dict[str, Any]:
    from panoptic_ros.bench.studies.cameras import study_cameras

    rig = _of_type(request.rig, "vga")
    counts = (len(rig),) if request.name == "nodes" else request.cameras
    result = study_cameras(
        rig, request.people, counts, request.frames, request.seed, request.noise, request.settings, progress
    )
    return result | {"study": request.name}


def _resolution(request: StudyRequest, progress: Progress) -> dict[str, Any]:
    from panoptic_ros.bench.studies.resolution import study_resolution

    hd, vga = read_rig(request.rig, types=("hd",)), read_rig(request.rig, types=("vga",))
    return study_resolution(
        hd, vga, request.cameras[0], request.people, request.frames, request.seed, MODEL, request.settings,
        progress,
    )  # fmt: skip


def _of_type(path: Path, kind: str) -> Rig:
    """The cameras of a type, for files that know types; else all."""
    try:
        return read_rig(path, types=(kind,))
    except UsageError:
        return read_rig(path)
