"""Exports results for `panoptic export`. The suffix of the output file selects the format."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain.body_shape import offsets_of
from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.domain.subjects import BodyState
from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.export.bvh import bvh_text
from panoptic_ros.export.gltf import glb_bytes
from panoptic_ros.export.opensim import mot_text, trc_text
from panoptic_ros.export.urdf import urdf_text
from panoptic_ros.io.body_files import read_bodies
from panoptic_ros.io.body_models import DEFAULT_MODEL, read_body_model, read_body_shape
from panoptic_ros.io.colors import rgb_of
from panoptic_ros.io.files import write_bytes
from panoptic_ros.running.viewer.recordings import open_recorded
from panoptic_ros.stage import Progress, untold
from panoptic_ros.view.page.recorded import RecordedScene


class ExportOptions(NamedTuple):
    """Options of an export.

    Args:
        begin_s: start of the exported interval, s from the beginning of the recording.
        end_s: end of the exported interval, s; None = the end of the recording.
        segments: name or file of the segment model (skeleton) of the bodies.
        rig: calibration file that replaces the rig of the results; None = that of the results.
    """

    begin_s: float = 0.0
    end_s: float | None = None
    segments: str = DEFAULT_MODEL
    rig: Path | None = None


Writer = Callable[[Path, Path, ExportOptions, Progress], list[Path]]
# returns the content of one person's file
TextWriter = Callable[[SegmentModel, Sequence[BodyState], Path], str]


def export(path: Path, out: Path, wanted: ExportOptions, progress: Progress = untold) -> list[Path]:
    """Write results or a bag to a file and return the paths of all files written.

    Formats for a single person give one file per person.

    Raises:
        UsageError: if there is no such format, or nothing to write.
    """
    writer = WRITERS.get(out.suffix)
    if writer is None:
        raise UsageError(
            f"--out {out}: there is no format {out.suffix or 'without suffix'!r}; there are "
            f"{', '.join(WRITERS)}"
        )
    return writer(path, out, wanted, progress)


def _write_html(path: Path, out: Path, wanted: ExportOptions, progress: Progress) -> list[Path]:
    """Write one HTML page that shows the whole recording, with images."""
    from panoptic_ros.view.page.one_file import one_file

    scene = open_recorded(path, wanted.rig)
    if not isinstance(scene, RecordedScene):
        raise UsageError(f"{path} is neither the results of `panoptic run` or `solve` nor a bag")
    try:
        if not scene.has_people:
            raise UsageError(
                f"{path} has no skeletons; `panoptic run --bag {path} --out RESULTS` computes them from "
                "images or 2D people"
            )
        scene.scan(lambda: False, lambda: None)
        write_bytes(out, one_file(scene, wanted.begin_s, wanted.end_s, progress))
    finally:
        scene.close()
    return [out]


def _people_of(path: Path, wanted: ExportOptions) -> tuple[SegmentModel, dict[int, list[BodyState]]]:
    """Return the segment model, and the bodies of the results by id in time order.

    Raises:
        DataError: if there are none.
    """
    model = read_body_model(wanted.segments)
    names, states = read_bodies(path / "kinematics.json.gz" if path.is_dir() else path)
    if names != model.names:
        raise DataError(f"{path}: bodies of other segments than {', '.join(model.names)}; give --segments")
    first = min((state.stamp_ns for state in states), default=0)
    begin, end = wanted.begin_s, float("inf") if wanted.end_s is None else wanted.end_s
    people: dict[int, list[BodyState]] = {}
    for state in sorted(states, key=lambda state: (state.id, state.stamp_ns)):
        if begin <= 1e-9 * (state.stamp_ns - first) <= end:
            people.setdefault(state.id, []).append(state)
    if not people:
        raise DataError(f"{path} has no bodies between {begin:g} and {end:g} s")
    return model, people


def _each(write: TextWriter) -> Writer:
    """Return a writer that makes one file per person.

    A single person's file is named `out`. With several people, the id is added to each name.
    """

    def write_all(path: Path, out: Path, wanted: ExportOptions, progress: Progress) -> list[Path]:
        model, people = _people_of(path, wanted)
        files = []
        for done, (number, own) in enumerate(people.items()):
            files.append(out if len(people) == 1 else out.with_name(f"{out.stem}-{number}{out.suffix}"))
            write_bytes(files[-1], write(model, own, files[-1]).encode())
            progress((done + 1) / len(people), f"person {number}")
        return files

    return write_all


def _urdf(model: SegmentModel, states: Sequence[BodyState], out: Path) -> str:
    """Return the URDF of a body with its measured segment lengths."""
    places, frames = (np.array([getattr(s, name) for s in states]) for name in ("places", "frames"))
    number = states[0].id
    offsets = offsets_of(model, places, frames)
    return urdf_text(read_body_shape(model), offsets, f"p{number}", rgb_of(number))


def _write_glb(path: Path, out: Path, wanted: ExportOptions, progress: Progress) -> list[Path]:
    """Write one animated scene that contains all people."""
    model, people = _people_of(path, wanted)
    colours = {number: rgb_of(number) for number in people}
    write_bytes(out, glb_bytes(read_body_shape(model), people, colours))
    progress(1.0, f"{len(people)} people")
    return [out]


WRITERS: dict[str, Writer] = {
    ".html": _write_html,
    ".bvh": _each(lambda model, states, out: bvh_text(model, states)),
    ".glb": _write_glb,
    ".trc": _each(lambda model, states, out: trc_text(model, states, out.name)),
    ".mot": _each(lambda model, states, out: mot_text(model, states, out.stem)),
    ".urdf": _each(_urdf),
}
