"""Compiles all kernels ahead of time, in tasks that several processes share.

`python -m panoptic_ros.running.compiling.kernel_tasks PROCESSES [TASK ...]` compiles the named tasks, or all.
It loads all modules once, then forks. Each finished task prints one line: the total number of tasks, the
number of kernels that the task compiled, its processor time in seconds, its name.
"""

from __future__ import annotations

import gc
import os
import sys
import time
import traceback
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np

from panoptic_ros.association.known_occluders import occluded_depths
from panoptic_ros.calibration.boards import Board
from panoptic_ros.calibration.quality import quality_of
from panoptic_ros.calibration.rig_start import CameraInput
from panoptic_ros.calibration.solve import calibrate_rig
from panoptic_ros.calibration.target_views import TargetView
from panoptic_ros.continuous.config import ContinuousConfig
from panoptic_ros.continuous.passes import ContinuousPass
from panoptic_ros.continuous.subjects.passes import SubjectPass
from panoptic_ros.detection.stage import warm_up as detection
from panoptic_ros.domain import Occluders
from panoptic_ros.domain.camera import POSE_AND_MATRIX
from panoptic_ros.domain.subjects import Subject
from panoptic_ros.geometry.symmetric import largest_eigenvalue
from panoptic_ros.graph.build import configure, make_stage, resolve
from panoptic_ros.graph.nodes import NODES
from panoptic_ros.graph.recording import InMemoryRecording
from panoptic_ros.io.body_context import body_extras
from panoptic_ros.io.body_models import read_body_model
from panoptic_ros.kernels import on_compilation
from panoptic_ros.simulation import SKELETON, Ring, SimulatedScene, Simulation, simulate
from panoptic_ros.simulation.board_sessions import BoardScene, simulate_board
from panoptic_ros.simulation.rendering import Studio
from panoptic_ros.solving.calibration_errors import CalibrationErrors
from panoptic_ros.stage import StageContext, untold


def _stage(name: str, **parameters: object) -> None:
    """Construct a stage. The constructor compiles every kernel that the stage can need."""
    take = _take()
    make_stage(name, configure({name: parameters})[name], StageContext(take.rig, SKELETON))


def _kinematics() -> None:
    """Compile the kernels of the kinematics stage, without designated subjects."""
    take = _take()
    config = configure({"kinematics": {"everybody": True}})["kinematics"]
    extras = body_extras((), "", "")
    make_stage("kinematics", config, StageContext(take.rig, SKELETON, extras))


def _continuous() -> None:
    """Compile the kernels of motion as a function of time."""
    _stage("continuous", active=True)
    take = simulate(SimulatedScene("to compile", ("walk",), Ring(3), frames=25), 0, 25)
    context = StageContext(take.rig, SKELETON)
    recording = InMemoryRecording({"detection_sets": tuple(take.detection_sets())})
    ContinuousPass(ContinuousConfig(clocks=True, rolling_shutter=True), context).run(recording, untold)
    model = read_body_model()
    subject = Subject(0, model.body(take.people[0].body.height), measured=False)
    SubjectPass(ContinuousConfig(), replace(context, extras={"segments": model}), subject).run(
        recording, untold
    )


def _calibration() -> None:
    """Compile the kernels of calibrations."""
    board = Board("checkerboard", 4, 3, 0.1)
    session = simulate_board(BoardScene(4, 30, smooth=True), board.points, 0)
    cameras = [CameraInput(camera.name, camera.image_size) for camera in session.rig.cameras]
    quality_of(calibrate_rig(cameras, [TargetView(*view) for view in session.views], board.points))


def _calibration_errors() -> None:
    """Compile the kernel for rigs whose calibration states a covariance."""
    camera = _take().rig.cameras[0]
    unknowns = POSE_AND_MATRIX + len(camera.intrinsics.distortion)
    CalibrationErrors.of((replace(camera, covariance=1e-6 * np.eye(unknowns)),))


def _occluders() -> None:
    """Compile the kernels for rigs with known occluders."""
    triangle = Occluders(np.eye(3), np.array([[0, 1, 2]]))
    occluded_depths(_take().rig.cameras[0], triangle)


def _rendering() -> None:
    """Compile the kernels that render images of simulated people."""
    take = _take()
    next(iter(Studio(take).camera(take.rig.names[0]).render(np.zeros(1))))


@lru_cache(maxsize=1)
def _take() -> Simulation:
    return simulate(SimulatedScene("to compile", ("walk",), Ring(2), frames=1), 0, 1)


# Longest tasks first, so that two processes that take turns compile few kernels twice.
# One compiles sound, images and offsets, the other compiles voting and the solvers for joints.
TASKS: dict[str, Callable[[], None]] = {
    "votes": partial(_stage, "voting"),
    "timecode": partial(_stage, "timecode"),
    "assembly": partial(_stage, "assembly"),
    "rendering": _rendering,
    "association": partial(_stage, "association"),
    "offsets": partial(_stage, "offsets", active=True),
    "refinement": partial(_stage, "refinement"),
    "exact votes": partial(_stage, "voting", method="exact", parts=True),
    "tracking": partial(_stage, "tracking"),
    "health": partial(_stage, "health"),
    "kinematics": _kinematics,
    "continuous": _continuous,
    "calibration": _calibration,
    "patches": partial(_stage, "patches", active=True),
    "flow": partial(_stage, "flow"),
    "occluders": _occluders,
    "calibration errors": _calibration_errors,
    "detection": detection,
    "all votes": partial(_stage, "voting", explain_away=False),
}


def main() -> int:
    """Compile the requested tasks; return 1 if a process failed, else 0."""
    gc.disable()  # garbage collection takes a tenth of the time, and the compiler's garbage fits into memory
    names = sys.argv[2:] or list(TASKS)
    for node in NODES.values():
        resolve(node.stage)
    largest_eigenvalue(np.eye(3))  # the first kernel initialises numba once, before the fork
    waiting = _queue(len(names))
    processes = [_fork(names, waiting) for _ in range(int(sys.argv[1]))]
    return int(any(os.waitpid(pid, 0)[1] for pid in processes))


def _queue(count: int) -> int:
    """Return the read end of a pipe that holds one byte per task.

    Processes take their tasks from it in turn.
    """
    reader, writer = os.pipe()
    os.write(writer, bytes(range(count)))
    os.close(writer)
    return reader


def _fork(names: list[str], waiting: int) -> int:
    """Fork a process that takes tasks until none is left; return its process id."""
    pid = os.fork()
    if pid:
        return pid
    status = 1
    try:
        while taken := os.read(waiting, 1):
            name = names[taken[0]]
            kernels, cpu_s = _compile(name)
            line = f"{len(names)} {kernels} {cpu_s} {name}\n"
            # one write call, as other processes share this stream
            os.write(sys.stdout.fileno(), line.encode())
        status = 0
    except BaseException:
        traceback.print_exc()
    os._exit(status)


def _compile(name: str) -> tuple[int, float]:
    """Run one task; return the number of compiled kernels and the processor time, s."""
    compiled: list[str] = []
    began = time.process_time()
    with on_compilation(compiled.append):
        TASKS[name]()
    count = sum(kernel.startswith("panoptic_ros.") for kernel in compiled)
    return count, time.process_time() - began


if __name__ == "__main__":
    sys.exit(main())
