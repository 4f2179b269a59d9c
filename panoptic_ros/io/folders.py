"""Write output folders whose files appear only when all of them are complete."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from panoptic_ros.errors import DataError
from panoptic_ros.io.files import file_errors

MARK = "report.json"  # a folder with this file was written by a run, and the next run may replace it


@contextmanager
def staged_folder(folder: Path) -> Iterator[Path]:
    """Yield a temporary folder next to `folder`; its content moves there on success, else is removed.

    Files and subfolders with the same names are replaced. Other content of `folder` remains.

    Raises:
        DataError: if `folder` is a file.
        EnvironmentProblem: on missing permissions, a full disk and other operating-system errors.
    """
    folder = Path(os.path.abspath(folder))
    temporary = folder.with_name(f".{folder.name}.{os.getpid()}.part")
    with file_errors(folder, "write"):
        try:
            temporary.mkdir(parents=True)
            yield temporary
            folder.mkdir(exist_ok=True)
            for entry in sorted(temporary.iterdir()):
                target = folder / entry.name
                if target.is_dir() and not target.is_symlink():
                    shutil.rmtree(target)
                os.replace(entry, target)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)


@contextmanager
def whole_folder(folder: Path) -> Iterator[Path]:
    """Yield a temporary folder that becomes `folder` on success; it is removed on an error.

    Raises:
        DataError: if `folder` exists already.
        EnvironmentProblem: on missing permissions, a full disk and other operating-system errors.
    """
    if folder.exists():
        raise DataError(f"{folder} exists already; choose another name or remove it")
    temporary = folder.with_name(f".{folder.name}.{os.getpid()}.part")
    with file_errors(folder, "write"):
        try:
            temporary.mkdir(parents=True)
            yield temporary
            os.replace(temporary, folder)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)
