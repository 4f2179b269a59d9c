"""Pausing and resuming a live node by a service, in place of a lifecycle: it keeps what it knows."""

from __future__ import annotations

from typing import Any

from rclpy.node import Node

from panoptic_ros.nodes.middleware.family import service_class

SERVICE = "std_srvs/srv/SetBool"


class Pausing:
    """Offers `~/pause`: true = take nothing that comes from now on, false = go on.

    Identities, tables of noise and clocks stay; people who were there are found again where they are by then.
    """

    def __init__(self, node: Node):
        self._node = node
        self.paused = False
        self.left_out = 0  # messages since it was paused
        self._service = node.create_service(service_class(SERVICE), "~/pause", self._asked)

    def leaves_out(self) -> bool:
        """Whether a message that has come is left out; counts it."""
        self.left_out += self.paused
        return self.paused

    def _asked(self, request: Any, response: Any) -> Any:
        response.success = self.paused != request.data
        if request.data and not self.paused:
            self.left_out = 0
            response.message = "paused"
        elif request.data:
            response.message = "paused already"
        elif self.paused:
            response.message = f"goes on; {self.left_out} messages were left out"
        else:
            response.message = "was not paused"
        self.paused = bool(request.data)
        if response.success:
            self._node.get_logger().info(response.message)
        return response
