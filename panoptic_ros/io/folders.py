"""Output folders that receive their files only when all of them are complete."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from panoptic_ros.errors import DataError
from panoptic_ros.io.files import file_errors

MARK = "report.json"  # a folder that holds one is a run's, and may be replaced by the next


@contextmanager
def staged_folder(folder: Path) -> Iterator[Path]:
    """A temporary folder beside `folder`; what it holds moves there if all goes well, else vanishes.

    Files and subfolders of the same names are replaced, others in `folder` are left alone.

    Raises:
        DataError: if `folder` is a file.
        EnvironmentProblem: on permissions, a full disk and other trouble of the machine.
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
    """Give a temporary folder that becomes `folder` if all goes well, and vanishes if not.

    Raises:
        DataError: if `folder` is there already.
        EnvironmentProblem: on permissions, a full disk and other trouble of the machine.
    """
    if folder.exists():
        raise DataError(f"{folder} is there already; choose another name or remove it")
    temporary = folder.with_name(f".{folder.name}.{os.getpid()}.part")
    with file_errors(folder, "write"):
        try:
            temporary.mkdir(parents=True)
            yield temporary
            os.replace(temporary, folder)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)
