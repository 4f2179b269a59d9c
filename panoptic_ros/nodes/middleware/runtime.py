"""Running nodes in this process until they are done or somebody stops them.

The time of a node, for those who ask thousands of times a second.

A timer that fires once. The executor on events may still call a timer that has been destroyed.

The executor of every process of the graph.

rclpy's usual one tells the middleware anew before every wait what all nodes wait for: services of
parameters, timers, guards, each subscription. That takes half a millisecond for each message, in Python, in
each of the processes that it goes through. The one on events is told by the middleware what has come.
"""

from __future__ import annotations

import contextlib
import importlib
import inspect
import os
import re
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import rclpy
from rclpy._rclpy_pybind11 import RCLError
from rclpy.clock import ROSClock
from rclpy.context import Context
from rclpy.exceptions import InvalidHandle
from rclpy.executors import Executor
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown

from panoptic_ros.errors import ContractError, EnvironmentProblem, PanopticError, UsageError
from panoptic_ros.io.interruption import first_request_told, listen_to_signals
from panoptic_ros.io.kernel_cache import full_disk_told


def now_of(node: Node) -> int:
    """The node's time, ns: the system's, unless it is simulated."""
    clock = node.get_clock()
    if isinstance(clock, ROSClock) and not clock.ros_time_is_active:
        return time.time_ns()
    return int(clock.now().nanoseconds)


class OneShot:
    """Calls a function once on the executor, some time from now, unless it is cancelled before."""

    def __init__(self, node: Node, seconds: float, call: Callable[[], None]):
        self._node, self._call = node, call
        self._over = False
        self._timer = node.create_timer(seconds, self._fire)

    def cancel(self) -> None:
        """Not any more."""
        if not self._over:
            self._over = True
            self._node.destroy_timer(self._timer)

    def _fire(self) -> None:
        if not self._over:
            self.cancel()
            self._call()


Taker = Callable[[bytes, Mapping[str, Any]], None]


def make_executor() -> Executor:
    """An executor for one thread. Call `spin_once` in a loop: its `spin` does not end on signals."""
    with contextlib.redirect_stderr(sys.__stderr__):  # it needs a file there, which notebooks have not
        return EventsExecutor()


def with_facts(take: Taker) -> Any:
    """A callback for a raw subscription that is handed the middleware's facts about each message besides.

    The executor on events hands over both as one tuple, others as two arguments.
    """

    def taken(*said: Any) -> None:
        data, facts = said if len(said) == 2 else said[0]
        take(data, facts)

    taken.__signature__ = inspect.signature(lambda data, facts: None)  # type: ignore[attr-defined]  # for rclpy
    return taken


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
