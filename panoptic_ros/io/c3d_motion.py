"""Read joints from C3D files (c3d.org), the format of motion capture and gait laboratories.

The C library runs in a child process (`apart`), so a crash of the library does not end this process.
"""

from __future__ import annotations

import importlib
import os
import pickle
import resource
import select
import signal
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np

from panoptic_ros.errors import DataError, EnvironmentProblem, one_line, shown
from panoptic_ros.io.loading import file_errors, largest_document, parsing, read_bytes
from panoptic_ros.io.motion_files import JointTrajectories

Array = np.ndarray
UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254}
LARGEST_VALUE = 1e9  # unit of the file; larger coordinates are treated as missing
# Second byte of every C3D file; processor code of big-endian files; largest frame number in the header.
SECOND_BYTE, MIPS, LARGEST = 0x50, 86, 0xFFFF
# Rotations to z up, by the laboratory axis that points up on the screen (POINT:Y_SCREEN).
UPRIGHT = {
    "+X": [[0, 1, 0], [0, 0, 1], [1, 0, 0]],
    "-X": [[0, -1, 0], [0, 0, 1], [-1, 0, 0]],
    "+Y": [[0, 0, 1], [1, 0, 0], [0, 1, 0]],
    "-Y": [[0, 0, -1], [1, 0, 0], [0, -1, 0]],
    "+Z": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "-Z": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
}


def read_c3d(path: Path) -> JointTrajectories:
    """Read all points of a C3D file by their labels; samples with a negative residual become NaN.

    Without POINT:Y_SCREEN, z is up.

    Raises:
        EnvironmentProblem: if the package ezc3d is not installed.
        DataError: naming the file and the fault.
    """
    data = read_bytes(path, largest_document())
    if len(data) < 512 or data[1] != SECOND_BYTE:
        raise DataError(
            f"{path} is not a C3D file: its second byte is not 0x50, or it is shorter than a block"
        )
    package = _package()
    with parsing(path):
        return _motion(package, data, path)


def _motion(package: Any, data: bytes, path: Path) -> JointTrajectories:
    # ezc3d trusts the lengths in a file, so a damaged file can crash its process
    what = f"{path} is not an intact C3D file; it"
    points, residuals, point = apart(lambda: _content(package, path), what, len(data))
    labels, rate = _labels(point), float(point["RATE"]["value"][0])
    joints = np.moveaxis(np.asarray(points[:3], float), 0, -1).swapaxes(0, 1)
    count, number = joints.shape[:2]
    if rate <= 0.0 or not np.isfinite(rate) or len(labels) != number or not joints.size:
        raise DataError(f"{path}: {count} frames of {number} points, {len(labels)} labels, at {rate:g} Hz")
    stated = _frames_stated(data)
    if count < stated < LARGEST:  # longer recordings do not state their length in the header
        raise DataError(f"{path} is not an intact C3D file: it has {count} of {stated} frames")
    joints[np.asarray(residuals)[0].T < 0.0] = np.nan
    joints[~(np.abs(joints) < LARGEST_VALUE)] = np.nan
    turn = np.array(UPRIGHT[_up(path, point)], float)
    return JointTrajectories(path.stem, labels, _unit(path, point) * joints @ turn.T, rate)


def _content(package: Any, path: Path) -> tuple[Array, Array, dict[str, dict[str, list[Any]]]]:
    """Return the points, their residuals and the POINT parameters that are used here."""
    with file_errors(path, "read"):
        found = package.c3d(str(path))
    point = {
        str(key): {"value": list(entry["value"])}
        for key, entry in found["parameters"]["POINT"].items()
        if key in ("RATE", "UNITS", "Y_SCREEN") or str(key).startswith("LABELS")
    }
    return found["data"]["points"], found["data"]["meta_points"]["residuals"], point


def _frames_stated(data: bytes) -> int:
    """Return the number of frames that the header states; ezc3d reads as many as exist."""
    kind = (data[0] - 1) * 512 + 3  # offset of the processor code in the first parameter block
    order: Literal["little", "big"] = "big" if kind < len(data) and data[kind] == MIPS else "little"
    first, last = (int.from_bytes(data[k : k + 2], order) for k in (6, 8))
    return last - first + 1


def _package() -> Any:
    try:
        return importlib.import_module("ezc3d")
    except ImportError:
        raise EnvironmentProblem("C3D files need the package ezc3d: pip install ezc3d") from None


def _labels(point: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the point labels: LABELS, and LABELS2 and so on in files with more than 255 points."""
    more = [f"LABELS{k}" for k in range(2, 100) if f"LABELS{k}" in point]
    return tuple(str(label) for key in ("LABELS", *more) for label in point[key]["value"])


def _text(point: Mapping[str, Any], key: str) -> str:
    values: Sequence[Any] = point[key]["value"] if key in point else ()
    return str(values[0]).strip() if len(values) else ""


def _unit(path: Path, point: Mapping[str, Any]) -> float:
    unit = _text(point, "UNITS")
    if unit.lower() not in UNITS:
        raise DataError(f"{path}: POINT:UNITS is {shown(unit)}; known are {', '.join(UNITS)}")
    return UNITS[unit.lower()]


def _up(path: Path, point: Mapping[str, Any]) -> str:
    up = _text(point, "Y_SCREEN").upper() or "+Z"
    if up not in UPRIGHT:
        raise DataError(f"{path}: POINT:Y_SCREEN is {shown(up)}; known are {', '.join(UPRIGHT)}")
    return up


Result = TypeVar("Result")
# CPU limit of the child process: LEAST_S (s), plus 1 s for each RATE bytes of the file.
LEAST_S, RATE = 1, 4_000_000
# s, waiting time for the answer of the child on a busy machine, plus the same 1 s for each RATE bytes
WAITING_S = 30
# Memory limit of the child process: LEAST bytes, plus TIMES the file size.
LEAST, TIMES = 512 << 20, 64


def apart(work: Callable[[], Result], what: str, size: int) -> Result:
    """Run `work` in a child process and return its result.

    Args:
        work: reads a file with a C library that can crash on damaged data. Its result must be picklable.
        what: subject of the error messages.
        size: file size in bytes, which sets the limits of CPU time and memory.

    Raises:
        DataError: if `work` raises, exceeds a limit, or crashes.
    """
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        _answer(work, reading, writing, size)
    os.close(writing)
    try:
        with os.fdopen(reading, "rb") as pipe:
            ready = select.select([pipe], [], [], WAITING_S + size / RATE)[0]
            answer = pipe.read() if ready else b""
        if not ready:
            os.kill(child, signal.SIGKILL)
    except BaseException:
        os.kill(child, signal.SIGKILL)
        raise
    finally:
        _, status = os.waitpid(child, 0)
    if status or not answer:
        raise DataError(f"{what} cannot be read: its reader crashes, so it is damaged; copy it again")
    good, result = pickle.loads(answer)
    if not good:
        raise DataError(f"{what} cannot be read: {result}")
    found: Result = result
    return found


def _answer(work: Callable[[], object], reading: int, writing: int, size: int) -> None:
    """Run the work in the child process, send the answer and exit."""
    status = 1
    try:
        os.close(reading)
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, 2)  # hide the crash output of the library
        mapped = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        for limit, most in (
            (resource.RLIMIT_CPU, int(time.process_time()) + LEAST_S + size // RATE),
            (resource.RLIMIT_AS, mapped + LEAST + TIMES * size),
            (resource.RLIMIT_CORE, 0),
        ):
            resource.setrlimit(limit, (most, most))
        try:
            answer: tuple[bool, object] = True, work()
        except Exception as error:
            answer = False, one_line(error)
        with os.fdopen(writing, "wb") as pipe:
            pickle.dump(answer, pipe)
        status = 0
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(status)
