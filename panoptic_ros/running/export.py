"""`panoptic export`: results in formats that others read, by the suffix of the file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from panoptic_ros.errors import UsageError
from panoptic_ros.io.files import write_bytes
from panoptic_ros.running.viewer.recordings import open_recorded
from panoptic_ros.stage import Progress, untold
from panoptic_ros.view.page.recorded import RecordedScene


def export(path: Path, out: Path, begin_s: float, end_s: float | None, progress: Progress = untold) -> None:
    """Write results or a bag to a file.

    Args:
        begin_s, end_s: the part of the recording, s from its beginning; None = to its end.

    Raises:
        UsageError: if there is no such format, or nothing to be written.
    """
    writer = WRITERS.get(out.suffix)
    if writer is None:
        raise UsageError(f"--out {out}: there is no format {out.suffix or 'without suffix'!r}; there are "
                         f"{', '.join(WRITERS)}")  # fmt: skip
    writer(path, out, begin_s, end_s, progress)


def _write_html(path: Path, out: Path, begin_s: float, end_s: float | None, progress: Progress) -> None:
    """One page that shows all of it, with images."""
    from panoptic_ros.view.page.one_file import one_file

    scene = open_recorded(path)
    if not isinstance(scene, RecordedScene):
        raise UsageError(f"{path} is neither the results of `panoptic run` nor a bag")
    scene.scan(lambda: False, lambda: None)
    write_bytes(out, one_file(scene, begin_s, end_s, progress))
    scene.close()


WRITERS: dict[str, Callable[[Path, Path, float, float | None, Progress], None]] = {".html": _write_html}
