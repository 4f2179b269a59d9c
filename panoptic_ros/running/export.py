"""`panoptic export`: results in formats that others read, by the suffix of the file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.export.bvh import bvh_text
from panoptic_ros.io.body_files import read_bodies
from panoptic_ros.io.body_models import read_body_model
from panoptic_ros.io.files import write_bytes
from panoptic_ros.running.viewer.recordings import open_recorded
from panoptic_ros.stage import Progress, untold
from panoptic_ros.view.page.recorded import RecordedScene


def export(
    path: Path, out: Path, begin_s: float, end_s: float | None, progress: Progress = untold
) -> list[Path]:
    """Write results or a bag to a file; of formats for one person to one each. Returns the files.

    Args:
        begin_s, end_s: the part of the recording, s from its beginning; None = to its end.

    Raises:
        UsageError: if there is no such format, or nothing to be written.
    """
    writer = WRITERS.get(out.suffix)
    if writer is None:
        raise UsageError(f"--out {out}: there is no format {out.suffix or 'without suffix'!r}; there are "
                         f"{', '.join(WRITERS)}")  # fmt: skip
    return writer(path, out, begin_s, end_s, progress)


def _write_html(
    path: Path, out: Path, begin_s: float, end_s: float | None, progress: Progress
) -> list[Path]:
    """One page that shows all of it, with images."""
    from panoptic_ros.view.page.one_file import one_file

    scene = open_recorded(path)
    if not isinstance(scene, RecordedScene):
        raise UsageError(f"{path} is neither the results of `panoptic run` nor a bag")
    scene.scan(lambda: False, lambda: None)
    write_bytes(out, one_file(scene, begin_s, end_s, progress))
    scene.close()
    return [out]


def _write_bvh(
    path: Path, out: Path, begin_s: float, end_s: float | None, progress: Progress
) -> list[Path]:
    """The bodies of results, one file for each person: `out`, and with their ids if there are several."""
    model = read_body_model()
    names, states = read_bodies(path / "kinematics.json.gz" if path.is_dir() else path)
    if names != model.names:
        raise DataError(f"{path}: bodies of other segments than {', '.join(model.names)}")
    first = min((state.stamp_ns for state in states), default=0)
    end = float("inf") if end_s is None else end_s
    kept = [state for state in states if begin_s <= 1e-9 * (state.stamp_ns - first) <= end]
    ids, files = sorted({state.id for state in kept}), []
    for done, number in enumerate(ids):
        own = sorted((s for s in kept if s.id == number), key=lambda state: state.stamp_ns)
        files.append(out if len(ids) == 1 else out.with_name(f"{out.stem}-{number}{out.suffix}"))
        write_bytes(files[-1], bvh_text(model, own).encode())
        progress((done + 1) / len(ids), f"person {number}")
    if not ids:
        raise DataError(f"{path} has no bodies between {begin_s:g} and {end:g} s")
    return files


WRITERS: dict[str, Callable[[Path, Path, float, float | None, Progress], list[Path]]] = {
    ".html": _write_html, ".bvh": _write_bvh
}  # fmt: skip
