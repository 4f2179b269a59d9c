"""Running nodes in this process until they are done or somebody stops them."""
from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

import rclpy
from rclpy._rclpy_pybind11 import RCLError
from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

from panoptic_ros.errors import ContractError, EnvironmentProblem, PanopticError
from panoptic_ros.io.kernel_cache import find_room_for_kernels, full_disk_told


@contextmanager
def quiet_at_shutdown() -> Iterator[None]:
    """End what is done without an error if rclpy has been shut down under it, as a signal does."""
    try:
        yield
    except (InvalidHandle, RCLError):
        if rclpy.ok():
            raise


def start_ros(arguments: Sequence[str] | None, **options: Any) -> None:
    """rclpy.init, with a word to the user if it fails.

    Raises:
        EnvironmentProblem: e.g. where ROS finds no folder for its logs.
    """
    try:
        rclpy.init(args=list(arguments) if arguments is not None else None, **options)
    except RCLError as error:
        raise EnvironmentProblem(
            f"ROS does not start ({str(error).split(', at ')[0]}); where HOME is not set or cannot be "
            "written, set ROS_LOG_DIR to a folder of yours; `panoptic doctor` tells more"
        ) from None


def run_nodes(
    make: Callable[[], Sequence[Any]],
    arguments: Sequence[str] | None = None,
    wanted: Callable[[], bool] = lambda: True,
) -> int:
    """Make nodes, spin them on one executor, and end cleanly on SIGINT and SIGTERM.

    Args:
        make: called after rclpy is initialised; the nodes have `fault`, `healthy` and `close()`.
        wanted: asked several times a second; the nodes end when it says no.

    Returns:
        the exit code: 0, or that of the error that ended a node, which is printed in one line.
    """
    find_room_for_kernels()
    try:
        start_ros(arguments)
    except EnvironmentProblem as error:
        print(f"panoptic: {error}", file=sys.stderr, flush=True)
        return error.exit_code
    nodes: Sequence[Any] = ()
    executor = SingleThreadedExecutor()
    try:
        with full_disk_told():
            nodes = make()
            _spin(executor, nodes, wanted)
    except (KeyboardInterrupt, ExternalShutdownException):
        return 0
    except PanopticError as error:
        print(f"panoptic: {error}", file=sys.stderr, flush=True)
        return error.exit_code
    except (InvalidHandle, RCLError):
        if rclpy.ok():  # else the context went away under a wait: the end, by SIGTERM
            raise
    finally:
        for node in nodes:
            node.close()
        executor.shutdown()
        for node in nodes:
            with suppress(InvalidHandle):
                node.destroy_node()
        rclpy.try_shutdown()
    return 0


def _spin(executor: Any, nodes: Sequence[Any], wanted: Callable[[], bool]) -> None:
    for node in nodes:
        executor.add_node(node)
    while rclpy.ok() and wanted():
        executor.spin_once(timeout_sec=0.2)
        sick = next((node for node in nodes if not node.healthy), None)
        if sick is not None and rclpy.ok():  # the end by a signal may reach a node's thread first
            raise sick.fault or ContractError(f"node {sick.get_name()} broke down; see above")


def leave(code: int) -> None:
    """End the process now; threads that block in a device or a network must not hold it."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)
