"""Initialisation of ROS, and spinning of nodes in this process until they end or are stopped.

All processes of the graph use the events executor. Before every wait, the standard executor of rclpy passes
all entities of all nodes to the middleware: parameter services, timers, guard conditions and subscriptions.
This takes half a millisecond of Python time per message, in each process that the message passes. The events
executor is notified by the middleware instead.
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
    """Return the time of a node, ns: the system time unless it is simulated.

    This shortcut suits callers that need the time thousands of times per second.
    """
    clock = node.get_clock()
    if isinstance(clock, ROSClock) and not clock.ros_time_is_active:
        return time.time_ns()
    return int(clock.now().nanoseconds)


class OneShot:
    """Timer that calls a function once on the executor, unless it is cancelled before.

    The events executor may still call a timer that has been destroyed; such a call does nothing.
    """

    def __init__(self, node: Node, seconds: float, call: Callable[[], None]):
        self._node, self._call = node, call
        self._over = False
        self._timer = node.create_timer(seconds, self._fire)

    def cancel(self) -> None:
        """Cancel the call."""
        if not self._over:
            self._over = True
            self._node.destroy_timer(self._timer)

    def _fire(self) -> None:
        if not self._over:
            self.cancel()
            self._call()


Taker = Callable[[bytes, Mapping[str, Any]], None]


def make_executor() -> Executor:
    """Return an executor with a single thread.

    Call `spin_once` in a loop: its `spin` does not end on signals.
    """
    with contextlib.redirect_stderr(sys.__stderr__):  # it needs a real file as stderr; notebooks replace it
        return EventsExecutor()


def with_facts(take: Taker) -> Any:
    """Return a callback for a raw subscription that also receives the middleware's message info.

    The events executor passes both as one tuple, other executors as two arguments.
    """

    def taken(*said: Any) -> None:
        data, facts = said if len(said) == 2 else said[0]
        take(data, facts)

    taken.__signature__ = inspect.signature(lambda data, facts: None)  # type: ignore[attr-defined]  # for rclpy
    return taken


# s, interval between thread switches. With Python's default of 5 ms, a worker waits 5 ms while messages are
# taken in a row.
SWITCH_S = 0.0005


@contextmanager
def quiet_once(ended: Callable[[], bool]) -> Iterator[None]:
    """Suppress errors about a destroyed node.

    Args:
        ended: returns whether the node is being stopped. If it is not, the error is raised.
    """
    try:
        yield
    except (InvalidHandle, RCLError):
        if not ended():
            raise


def in_namespace(namespace: str) -> list[str]:
    """Return ROS arguments that put all nodes of a process into a namespace; [] for no namespace.

    Raises:
        UsageError: if ROS does not allow this name.
    """
    if not namespace.strip("/"):
        return []
    if not re.fullmatch(r"/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*", namespace):
        raise UsageError(f"--namespace {namespace!r}: ROS allows letters, digits and _, e.g. lab or lab/left")
    return ["--ros-args", "-r", f"__ns:=/{namespace.strip('/')}"]


def start_ros(arguments: Sequence[str] | None, context: Context | None = None) -> None:
    """Initialise rclpy, with a clear message if that fails.

    The program handles signals itself. rclpy would handle them in a thread that shuts ROS down while the main
    thread destroys nodes. Sometimes this ends in a segmentation fault.

    Args:
        context: None: the default context of all nodes in this process.

    Raises:
        EnvironmentProblem: e.g. if ROS finds no folder for its logs.
    """
    _without_generator()
    try:
        words = list(arguments) if arguments is not None else None
        rclpy.init(args=words, context=context, signal_handler_options=SignalHandlerOptions.NO)
    except RCLError as error:
        raise EnvironmentProblem(
            f"ROS does not start ({str(error).split(', at ')[0]}); if HOME is not set or cannot be "
            "written, set ROS_LOG_DIR to a folder of yours; see `panoptic doctor`"
        ) from None


def _without_generator() -> None:
    """Import rosidl_generator_py, which finds the type supports of messages, without its message generator.

    The package imports the generator too if it is installed. Its parser takes 16 MB and 0.2 s in every
    process.
    """
    unused = "rosidl_generator_py.generate_py_impl"
    if unused not in sys.modules:
        sys.modules[unused] = None  # type: ignore[assignment]  # None makes Python refuse the import
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
        make: called after rclpy is initialised; returns nodes with `fault`, `healthy` and `close()`.
        wanted: called several times per second; the nodes end when it returns False.

    Returns:
        the exit code: 0, or that of the error that ended a node. The error is printed in one line.
    """
    sys.setswitchinterval(SWITCH_S)
    listen_to_signals(lambda: os._exit(0))  # nodes under construction leave nothing to clean up
    try:
        start_ros(arguments)
        with full_disk_told():
            nodes = make()
            with first_request_told() as asked:
                _spin(nodes, lambda: wanted() and not asked())
    except KeyboardInterrupt:  # second request to end, long after the first one
        return 0
    except PanopticError as error:
        print(f"panoptic: {error}", file=sys.stderr, flush=True)
        return error.exit_code
    return 0


def _spin(nodes: Sequence[Any], wanted: Callable[[], bool]) -> None:
    """Spin nodes while they are wanted, then destroy them and shut ROS down."""
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
    """End the process now, without waiting for threads that block in a device or a network."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)
