"""A timer that fires once. The executor on events may still call a timer that has been destroyed."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.node import Node


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
