"""Calibrations by other libraries from the same views of a board, in the Python interpreter of `--peers`."""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from panoptic_ros.calibration.boards import Board
from panoptic_ros.calibration.projection import LENS
from panoptic_ros.calibration.rig_start import CameraInput
from panoptic_ros.calibration.target_views import TargetView
from panoptic_ros.domain import Camera, Rig
from panoptic_ros.errors import EnvironmentProblem, UserError
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.io.loading import file_errors, parsing
from panoptic_ros.simulation.people_sessions import TrueJoints
from panoptic_ros.study.calibration import peer_child
from panoptic_ros.study.child import ONE_THREAD, answer_of

Array = np.ndarray
OWN = "panoptic"
LONGEST_S = 600.0  # s, limit of one library; aniposelib takes 5 to 40 s on the cases of the studies
BROWN_TERMS, FISHEYE_TERMS = 5, 4  # least terms of distortion that the libraries take
GIVEN, UNKNOWN = "given", "unknown"  # intrinsics


@dataclass(frozen=True)
class Problem:
    """Views of a board by cameras.

    Args:
        cameras: Cameras to calibrate. views: Views of all cameras.
        board: Checkerboard or ChArUco board that they show.
        lenses: Known intrinsics of the cameras; None = unknown.
    """

    cameras: Sequence[CameraInput]
    views: Sequence[TargetView]
    board: Board
    lenses: Sequence[Intrinsics] | None = None

    @property
    def intrinsics(self) -> str:
        """Return whether the intrinsics are given, as text."""
        return UNKNOWN if self.lenses is None else GIVEN


class Attempt(NamedTuple):
    """Calibration by one library.

    Args:
        program: Name of the library.
        rig: Cameras in the frame of the first camera; None = it failed.
        solve_s: Time, s, of the calibration; None = it failed.
        note: Reason of the failure, or a remark of the library.
    """

    program: str
    rig: Rig | None
    solve_s: float | None
    note: str


def add_peers(parser: argparse.ArgumentParser) -> None:
    """Add the option --peers PYTHON."""
    parser.add_argument(
        "--peers",
        type=_interpreter,
        metavar="PYTHON",
        help=f"Python interpreter of an environment with {' or '.join(peer_child.BOARD)}; they calibrate "
        "from the same 2D points",
    )


def _interpreter(text: str) -> str:
    if shutil.which(text) is None:
        raise argparse.ArgumentTypeError(f"{text!r} is no program; give a Python interpreter")
    return text


def with_known_lens(camera: CameraInput, lens: Intrinsics, sd: tuple[float, float, float]) -> CameraInput:
    """Return a camera whose lens is known.

    Args:
        sd: Standard deviations of the focal lengths (relative), principal point (px) and distortion.
    """
    matrix = lens.matrix
    values = np.zeros(LENS)
    values[:4] = matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]
    values[4 : 4 + len(lens.distortion)] = lens.distortion
    spread = np.full(LENS, sd[2])
    spread[:4] = sd[0] * values[0], sd[0] * values[1], sd[1], sd[1]
    return camera._replace(known=(values, np.diag(1.0 / spread**2)))


def attempts(problem: Problem, python: str) -> Iterator[Attempt]:
    """Yield the calibration by each library; a library that fails gives the reason."""
    return _attempts(peer_child.BOARD, problem.cameras, _tables(problem), python)


def attempts_from_people(rig: Rig, joints: TrueJoints, python: str) -> Iterator[Attempt]:
    """Yield the calibration by each library from the same joints as `attempts`, with the lenses of the rig.

    The libraries do not associate people, so they receive the true association.
    """
    cameras = [CameraInput(camera.name, camera.image_size) for camera in rig.cameras]
    tables = {
        "sizes": np.array([camera.size for camera in cameras]),
        "fisheye": np.array([camera.intrinsics.lens == "fisheye" for camera in rig.cameras]),
        "cameras": joints.camera,
        "instants": joints.frame,
        "people": joints.person,
        "joints": joints.joint,
        "pixels": joints.pixels,
        **_lens_tables([camera.intrinsics for camera in rig.cameras]),
    }
    return _attempts(peer_child.PEOPLE, cameras, tables, python)


def _attempts(
    libraries: Iterable[str], cameras: Sequence[CameraInput], tables: dict[str, Any], python: str
) -> Iterator[Attempt]:
    for library in libraries:
        try:
            yield _calibrated(cameras, tables, library, python)
        except UserError as error:
            yield Attempt(library, None, None, str(error))


def _calibrated(cameras: Sequence[CameraInput], tables: dict[str, Any], library: str, python: str) -> Attempt:
    """Calibrate in a child process.

    Raises:
        EnvironmentProblem: if the library fails.
        CalibrationError: if its cameras are impossible.
    """
    with tempfile.TemporaryDirectory() as folder:
        inputs, outputs = Path(folder) / "in.npz", Path(folder) / "out.npz"
        np.savez(inputs, **tables)
        command = [python, str(Path(peer_child.__file__)), library, str(inputs), str(outputs)]
        try:
            with file_errors(Path(python), "run"):
                done = subprocess.run(
                    command,
                    text=True,
                    capture_output=True,
                    env={**os.environ, **ONE_THREAD},
                    check=False,
                    timeout=LONGEST_S,
                )
        except subprocess.TimeoutExpired:
            raise EnvironmentProblem(f"{library} takes more than {LONGEST_S:g} s") from None
        answer_of(done, library)
        with parsing(f"answer of {library}", EnvironmentProblem), np.load(outputs) as found:
            rig = _rig(cameras, found)
            return Attempt(library, rig, float(found["seconds"]), str(found["note"]))


def _tables(problem: Problem) -> dict[str, Any]:
    """Return the arrays that `peer_child` reads."""
    views, points = problem.views, problem.board.points
    fisheye = [camera.model.fisheye for camera in problem.cameras]
    tables = {
        "points": points,
        "grid": np.array([len(np.unique(points[:, 0])), len(np.unique(points[:, 1]))]),
        "square_m": np.array(problem.board.size),
        "sizes": np.array([camera.size for camera in problem.cameras]),
        "fisheye": np.array(fisheye),
        "cameras": np.array([view.camera for view in views]),
        "instants": np.array([view.instant for view in views]),
        "starts": np.cumsum([0, *(len(view.numbers) for view in views)]),
        "numbers": np.concatenate([view.numbers for view in views]),
        "pixels": np.concatenate([view.pixels for view in views]),
    }
    return tables if problem.lenses is None else {**tables, **_lens_tables(problem.lenses)}


def _lens_tables(lenses: Sequence[Intrinsics]) -> dict[str, Any]:
    least = FISHEYE_TERMS if all(lens.lens == "fisheye" for lens in lenses) else BROWN_TERMS
    terms = max(least, *(len(lens.distortion) for lens in lenses))
    return {
        "matrices": np.stack([lens.matrix for lens in lenses]),
        "distortions": np.stack(
            [np.pad(lens.distortion, (0, terms - len(lens.distortion))) for lens in lenses]
        ),
    }


def _rig(cameras: Sequence[CameraInput], found: np.lib.npyio.NpzFile) -> Rig:
    """Return the cameras that a library found, in the frame of the first camera."""
    poses = [Rigid(turn, move.ravel()) for turn, move in zip(found["rotations"], found["translations"])]
    first = poses[0].inverse()
    return Rig(
        tuple(
            Camera(
                camera.name,
                camera.size,
                Intrinsics(matrix, terms.ravel(), "fisheye" if camera.model.fisheye else "brown"),
                pose.compose(first),
            )
            for camera, matrix, terms, pose in zip(cameras, found["matrices"], found["distortions"], poses)
        )
    )
