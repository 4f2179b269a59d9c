"""Mark live recordings (takes) as open until they are closed, and find unclosed takes after a crash.

A take folder holds the file `take.open` from its first second until it is closed. The recording process keeps
a lock on that file. A file without a lock means that the process was killed or the power failed. The user's
state folder also lists the paths of open takes; `panoptic doctor` and the next run find them there.
"""

from __future__ import annotations

import fcntl
import json
import os
import platform
import time
from contextlib import suppress
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

from panoptic_ros.io.files import file_errors
from panoptic_ros.io.resources import state_folder

OPEN = "take.open"  # name of the marker file in the folder of a take
LISTED = "takes"  # folder in the user's state folder, with one file for each open take


@dataclass(frozen=True)
class UnclosedTake:
    """A take that its process did not close.

    Args:
        path: its folder.
        began: start in local time; "" if the marker file does not state it.
    """

    path: Path
    began: str = ""

    def __str__(self) -> str:
        began = f", which began at {self.began}," if self.began else ""
        return (
            f"the take {self.path}{began} was not closed (its process was killed, the disk was full or the "
            f"power failed); `panoptic bag repair {self.path}` saves what was recorded"
        )


class OpenTake:
    """Marker of a take that is being recorded.

    Args:
        folder: folder of the take; it exists.

    Raises:
        EnvironmentProblem: if the marker file cannot be written.
    """

    def __init__(self, folder: Path):
        self._mark = folder / OPEN
        self._entry = _entry_of(folder)
        about = {"process": os.getpid(), "host": platform.node(), "began": time.strftime("%Y-%m-%d %H:%M:%S")}
        with file_errors(self._mark, "write"):
            self._lock = os.open(self._mark, os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o666)
            with suppress(OSError):  # on a file system without locks the marker file alone is used
                fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            os.write(self._lock, json.dumps(about).encode())
            os.fsync(self._lock)
            sync_folder(folder)
            sync_folder(folder.parent)
        with suppress(OSError):  # without a state folder, the marker file in the take folder remains
            self._entry.parent.mkdir(parents=True, exist_ok=True)
            self._entry.write_text(str(folder.resolve()))

    def close(self) -> None:
        """Remove the marker file: the take is complete."""
        self._mark.unlink(missing_ok=True)
        self.leave()
        with suppress(OSError):
            self._entry.unlink(missing_ok=True)

    def leave(self) -> None:
        """Release the lock and keep the marker file: the take is incomplete."""
        if self._lock >= 0:
            os.close(self._lock)
            self._lock = -1


def sync_folder(folder: Path) -> None:
    """Sync the entries of a folder to the disk, if the file system supports it."""
    _sync(folder)


def sync_files(folder: Path) -> None:
    """Sync a folder and its files to the disk, if the file system supports it."""
    for path in (*folder.iterdir(), folder, folder.parent):
        _sync(path)


def _sync(path: Path) -> None:
    with suppress(OSError):
        descriptor = os.open(path, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def is_recorded_now(folder: Path) -> bool:
    """Return whether a process records this take now."""
    try:
        descriptor = os.open(folder / OPEN, os.O_RDWR)
    except OSError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    finally:
        os.close(descriptor)
    return False


def unclosed_take(folder: Path) -> UnclosedTake | None:
    """Return the take in a folder if it is marked open and no process records it; else None."""
    mark = folder / OPEN
    if not mark.is_file() or is_recorded_now(folder):
        return None
    began = ""
    with suppress(OSError, ValueError, AttributeError):
        began = str(json.loads(mark.read_bytes()[:4096]).get("began", ""))[:40]
    return UnclosedTake(folder, began)


def unclosed_takes() -> list[UnclosedTake]:
    """Return the user's takes that are marked open without a recording process; unlist finished takes."""
    found = []
    with suppress(OSError):
        for entry in sorted((state_folder() / LISTED).iterdir()):
            with suppress(OSError, UnicodeDecodeError):
                folder = Path(entry.read_text())
                take = unclosed_take(folder)
                if take is not None:
                    found.append(take)
                # otherwise its disk is not mounted
                elif folder.parent.exists() and not (folder / OPEN).is_file():
                    entry.unlink(missing_ok=True)
    return found


def mark_saved(folder: Path) -> None:
    """Remove the marker of a take that was repaired into a new folder."""
    if unclosed_take(folder) is not None:
        with suppress(OSError):
            (folder / OPEN).unlink(missing_ok=True)
            _entry_of(folder).unlink(missing_ok=True)


def _entry_of(folder: Path) -> Path:
    """Return the state file that lists a take."""
    return state_folder() / LISTED / sha256(str(folder.resolve()).encode()).hexdigest()[:20]
