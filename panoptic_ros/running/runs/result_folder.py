"""Manages the folder with the results of a run, and protects the user's files in it.

Results of recordings are made in a hidden folder inside the user's folder, and move up when all are complete.
So a mount point, a link and files of the user stay unchanged. A live take is written in place, in a folder
that was empty, and is marked open until it is closed (`io.takes`). The file `report.json` lists the files
that a run made. Only these files are ever replaced or deleted.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.io.files import file_errors
from panoptic_ros.io.folders import MARK
from panoptic_ros.io.takes import OPEN, OpenTake, is_recorded_now, sync_folder, unclosed_take

STAGED = ".results-{}.part"  # hidden folder of a run; the number is its process id
FILES = "files"  # key of the list of files in report.json


class LiveFolder:
    """Folder of a live take.

    Args:
        path: path of the folder.
        created: whether this run created it.
    """

    def __init__(self, path: Path, created: bool):
        self.path, self._created = path, created
        self._take = OpenTake(path)

    def close(self) -> None:
        """Mark the take as closed: everything that was recorded is on the disk."""
        sync_folder(self.path)
        self._take.close()

    def leave(self) -> None:
        """Leave the take marked as open, as it could not be closed."""
        self._take.leave()

    def give_up(self, names: Iterable[str]) -> None:
        """Delete the folder of a take in which nothing was recorded.

        Args:
            names: files and folders that the run made. All others stay.
        """
        self._take.close()
        for name in names:
            path = self.path / name
            if path.is_dir():
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink(missing_ok=True)
        if self._created:
            with suppress(OSError):  # the folder meanwhile contains another file
                self.path.rmdir()


def open_live_folder(out: Path) -> LiveFolder:
    """Create the folder of a live take and mark it as open.

    Raises:
        UsageError: if `out` is not a new or empty folder.
        EnvironmentProblem: if it cannot be written.
    """
    with file_errors(out, "write"):
        _check_place(out)
        found = sorted(path.name for path in out.iterdir()) if out.is_dir() else []
        if found:
            more = " and more" if len(found) > 1 else ""
            raise UsageError(
                f"--out {out} holds {found[0]}{more}; a live take replaces nothing: choose a new or empty "
                "folder"
            )
        created = not out.exists()
        out.mkdir(parents=True, exist_ok=True)
    return LiveFolder(out, created)


@contextmanager
def result_folder(out: Path) -> Iterator[Path]:
    """Yield a hidden folder inside `out`. Its files move to `out` at the end, or are deleted on an error.

    Files that the last run made are replaced. All other files stay.

    Raises:
        UsageError: if `out` is a file, or a folder with other content than the results of a run.
        EnvironmentProblem: if it cannot be written.
    """
    out = Path(out)
    with file_errors(out, "write"):
        _check_place(out)
        created = not out.exists()
        own = _own_files(out)
        if not created and own is None and any(not _is_staged(path) for path in out.iterdir()):
            raise UsageError(f"--out {out} holds files that are not results of a run; choose another folder")
        out.mkdir(parents=True, exist_ok=True)
        _remove_stale(out)
        part = out / STAGED.format(os.getpid())
        part.mkdir()
    done = False
    try:
        yield part
        with file_errors(out, "write"):
            _move_up(part, out, own or [])
        done = True
    finally:
        shutil.rmtree(part, ignore_errors=True)
        if created and not done:
            with suppress(OSError):
                out.rmdir()


def files_below(folder: Path) -> list[str]:
    """Return the sorted paths of all files in a folder and its subfolders, relative to the folder.

    The mark of an open take is left out.
    """
    found = (Path(place) / name for place, _, names in os.walk(folder) for name in names)
    return sorted(str(path.relative_to(folder)) for path in found if path.name != OPEN)


def _check_place(out: Path) -> None:
    """Check that `out` can receive results.

    Raises:
        UsageError: if it is a file, a broken link, or the folder of an open take.
    """
    if out.is_symlink() and not out.exists():
        raise UsageError(
            f"--out {out} is a link to {os.readlink(out)}, which does not exist; make that folder, or "
            "remove the link"
        )
    if out.exists() and not out.is_dir():
        raise UsageError(f"--out {out} is a file; give a folder")
    if out.is_dir() and is_recorded_now(out):
        raise UsageError(f"--out {out} is a take that is being recorded now; choose another folder")
    if (take := unclosed_take(out)) is not None:
        raise UsageError(f"--out {out}: {take}; choose another folder")


def _own_files(out: Path) -> list[str] | None:
    """Return the files that the last run made in `out`, relative to it; None if there is no valid report."""
    try:
        document = json.loads((out / MARK).read_bytes())
        names = [str(name) for name in document[FILES]]
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return [name for name in names if ".." not in Path(name).parts and not Path(name).is_absolute()]


def _is_staged(path: Path) -> bool:
    before, after = STAGED.split("{}")
    return path.name.startswith(before) and path.name.endswith(after)


def _remove_stale(out: Path) -> None:
    """Remove the hidden folders of runs that were killed."""
    before, after = STAGED.split("{}")
    for path in out.iterdir():
        number = path.name.removeprefix(before).removesuffix(after)
        if _is_staged(path) and number.isdigit() and not Path(f"/proc/{number}").exists():
            shutil.rmtree(path, ignore_errors=True)


def _move_up(part: Path, out: Path, own: list[str]) -> None:
    """Move all results to `out`, the report last; delete files of the last run that are not replaced.

    Raises:
        DataError: if a file of the user blocks the path of a result. The results then stay in a folder inside
            `out`.
    """
    new = files_below(part)
    taken = [name for name in new if name not in own and (out / name).exists()]
    blocked = [
        name
        for name in new
        if any(
            p.is_file() and str(p.relative_to(out)) not in own
            for p in (out / name).parents
            if out in p.parents
        )
    ]
    if in_the_way := sorted((*taken, *blocked)):
        beside = _free(out)
        os.replace(part, beside)
        raise DataError(
            f"{out / in_the_way[0]} was not made by a run and is not replaced; the results are in {beside}"
        )
    # from here until the report is moved, the results in the folder are incomplete
    (out / MARK).unlink(missing_ok=True)
    for name in own:
        if name not in new:
            (out / name).unlink(missing_ok=True)
    for folder in sorted({out / parent for name in own for parent in Path(name).parents}, reverse=True):
        if folder != out:
            with suppress(OSError):  # the folder contains files of the user, or no longer exists
                folder.rmdir()
    for name in sorted(new, key=lambda name: name == MARK):
        (out / name).parent.mkdir(parents=True, exist_ok=True)
        os.replace(part / name, out / name)


def _free(out: Path) -> Path:
    """Return an unused path inside `out`."""
    number = 2
    while (out / f"results-{number}").exists():
        number += 1
    return out / f"results-{number}"
