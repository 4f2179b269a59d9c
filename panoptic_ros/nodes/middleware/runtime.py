"""Running nodes in this process until they are done or somebody stops them."""

from __future__ import annotations

import importlib
import os
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import rclpy
from rclpy._rclpy_pybind11 import RCLError
from rclpy.context import Context
from rclpy.exceptions import InvalidHandle
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown

from panoptic_ros.errors import ContractError, EnvironmentProblem, PanopticError, UsageError
from panoptic_ros.io.interruption import first_request_told, listen_to_signals
from panoptic_ros.io.kernel_cache import full_disk_told
from panoptic_ros.nodes.middleware.executor import make_executor

SWITCH_S = 0.0005  # Python's 5 ms is what a worker waits for while messages are taken in a row


@contextmanager
def quiet_once(ended: Callable[[], bool]) -> Iterator[None]:
    """End what is done without an error if its node has been destroyed under it."""
    try:
        yield
    except (InvalidHandle, RCLError):
        if not ended():
            raise


def in_namespace(namespace: str) -> list[str]:
    """Arguments for ROS that put all nodes of a process into a namespace; "" = none.

    Raises:
        UsageError: if ROS allows no such name.
    """
    if not namespace.strip("/"):
        return []
    if not re.fullmatch(r"/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*", namespace):
        raise UsageError(f"--namespace {namespace!r}: ROS allows letters, digits and _, e.g. lab or lab/left")
    return ["--ros-args", "-r", f"__ns:=/{namespace.strip('/')}"]


def start_ros(arguments: Sequence[str] | None, context: Context | None = None) -> None:
    """rclpy.init, with a word to the user if it fails.

    Args:
        context: None: that of all nodes of this process that have none of their own.

    Signals stay with the program: rclpy would answer them in a thread of its own, which shuts ROS down
    while the main thread destroys nodes, and at times both together end in a segmentation fault.

    Raises:
        EnvironmentProblem: e.g. where ROS finds no folder for its logs.
    """
    _without_generator()
    try:
        words = list(arguments) if arguments is not None else None
        rclpy.init(args=words, context=context, signal_handler_options=SignalHandlerOptions.NO)
    except RCLError as error:
        raise EnvironmentProblem(
            f"ROS does not start ({str(error).split(', at ')[0]}); where HOME is not set or cannot be "
            "written, set ROS_LOG_DIR to a folder of yours; `panoptic doctor` tells more"
        ) from None


def _without_generator() -> None:
    """Load the package through which messages find their type supports, without the generator of messages.

    The package loads both, unless the generator is not installed; its parser takes 16 MB and 0.2 s in
    every process.
    """
    unused = "rosidl_generator_py.generate_py_impl"
    if unused not in sys.modules:
        sys.modules[unused] = None  # type: ignore[assignment]  # how Python says: not to be imported
        try:
            importlib.import_module("rosidl_generator_py")
        finally:
            del sys.modules[unused]


def run_nodes(
    make: Callable[[], Sequence[Any]],
    arguments: Sequence[str] | None = None,
    wanted: Callable[[], bool] = lambda: True,
) -> int:
    """Make nodes, spin them on one executor, and end cleanly on SIGINT, SIGTERM and SIGHUP.

    Args:
        make: called after rclpy is initialised; the nodes have `fault`, `healthy` and `close()`.
        wanted: asked several times a second; the nodes end when it says no.

    Returns:
        the exit code: 0, or that of the error that ended a node, which is printed in one line.
    """
    sys.setswitchinterval(SWITCH_S)
    listen_to_signals(lambda: os._exit(0))  # nodes that are being made leave nothing to tidy up
    try:
        start_ros(arguments)
        with full_disk_told():
            nodes = make()
            with first_request_told() as asked:
                _spin(nodes, lambda: wanted() and not asked())
    except KeyboardInterrupt:  # asked again, long after the first time
        return 0
    except PanopticError as error:
        print(f"panoptic: {error}", file=sys.stderr, flush=True)
        return error.exit_code
    return 0


def _spin(nodes: Sequence[Any], wanted: Callable[[], bool]) -> None:
    """Spin nodes as long as they are wanted, then destroy them and shut ROS down."""
    executor = make_executor()
    try:
        for node in nodes:
            executor.add_node(node)
        while wanted():
            executor.spin_once(timeout_sec=0.2)
            sick = next((node for node in nodes if not node.healthy), None)
            if sick is not None:
                raise sick.fault or ContractError(f"node {sick.get_name()} broke down; see above")
    finally:
        for node in nodes:
            node.close()
        executor.shutdown()
        for node in nodes:
            node.destroy_node()
        try_shutdown()


def leave(code: int) -> None:
    """End the process now; threads that block in a device or a network must not hold it."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)
