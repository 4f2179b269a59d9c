"""The executor of every process of the graph.

rclpy's usual one tells the middleware anew before every wait what all nodes wait for: services of
parameters, timers, guards, each subscription. That takes half a millisecond for each message, in Python, in
each of the processes that it goes through. The one on events is told by the middleware what has come.
"""

from __future__ import annotations

import contextlib
import inspect
import sys
from collections.abc import Callable, Mapping
from typing import Any

from rclpy.executors import Executor
from rclpy.experimental.events_executor import EventsExecutor

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
