"""Service of a node for the records of requested instants, e.g. `/skeletons_at`.

A request waits until all input that its instant needs has come, or until its patience is over. It is answered
from the worker of the node, in the step that brought the last input, before the other output of this step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rclpy.qos import QoSProfile

from panoptic_ros.errors import DataError
from panoptic_ros.io.messages import MessageFamily, to_message
from panoptic_ros.io.messages.family import time_ns
from panoptic_ros.nodes.middleware.family import ros_messages, service_class
from panoptic_ros.nodes.middleware.read_together import GatheringNode
from panoptic_ros.nodes.middleware.runtime import OneShot, quiet_once
from panoptic_ros.stage import InstantRange, RequestStage

MOST_WAITING = 64  # requests that may wait at the same time
# requests and answers in the middleware's queues; with ROS's default of 10, requests at one time are lost
QUEUED = 4 * MOST_WAITING
LONGEST_S = 60.0  # s, longest patience


@dataclass(eq=False)
class _Request:
    """Request that waits.

    Args:
        stamp_ns: instant.
        patience_s: longest wait, s.
        header: identifies the caller.
        timer: ends the wait; None: there is no wait.
    """

    stamp_ns: int
    patience_s: float
    header: Any
    timer: OneShot | None = None


class InstantService:
    """Service that answers requests with the records of a stage.

    Args:
        kind: "package/srv/Name" with the fields of `SkeletonsAt`.
        name: name of the service.
        stage: returns the stage. It is used on the worker only.
        urge: schedules a call on the worker, ahead of waiting messages.
        frame_id: returns the frame of the records.
    """

    def __init__(
        self,
        node: GatheringNode,
        kind: str,
        name: str,
        stage: Callable[[], RequestStage],
        urge: Callable[[Callable[[], None]], None],
        frame_id: Callable[[], str],
    ):
        self._node, self._stage, self._urge, self._frame_id = node, stage, urge, frame_id
        self._kind = service_class(kind)
        self._waiting: list[_Request] = []
        self._timers = 0  # timers of requests that have no answer yet; used on the executor only
        self._closed = False
        # rclpy passes what the callback returns to `send_response`, with the header of the request. Executors
        # cannot wait for an answer, so the request is returned, and the answer is sent later.
        self._service = node.create_service(
            self._kind, name, lambda request, response: request, qos_profile=QoSProfile(depth=QUEUED)
        )
        self._send = self._service.send_response
        service: Any = self._service
        service.send_response = self._asked

    def close(self) -> None:
        """Stop answering."""
        self._closed = True

    def look(self) -> None:
        """Answer the requests whose input is complete; called on the worker after each step of the stage.

        The stage also calls it within its next steps.
        """
        stage = self._stage()
        for request in list(self._waiting):
            if stage.has_all_of(request.stamp_ns):
                self._end(request)
        stage.before_output(self.look)

    # ------------------------------------------------------------------ requests

    def _asked(self, request: Any, header: Any) -> None:
        """Take a request, on the executor."""
        try:
            stamp_ns = time_ns(request.stamp)
        except DataError as error:
            self._refuse(header, str(error), InstantRange(0, -1))
            return
        patience_s = request.patience.sec + 1e-9 * request.patience.nanosec
        if self._timers == MOST_WAITING:
            patience_s = 0.0
        taken = _Request(stamp_ns, min(patience_s, LONGEST_S), header)
        if taken.patience_s > 0.0:
            self._timers += 1
            taken.timer = OneShot(self._node, taken.patience_s, lambda: self._urge(lambda: self._over(taken)))
        self._urge(lambda: self._begin(taken))

    def _begin(self, request: _Request) -> None:
        stage = self._stage()
        complete = stage.has_all_of(request.stamp_ns)
        instants = stage.instants()
        too_old = instants.newest_ns >= instants.oldest_ns > request.stamp_ns
        if complete or too_old or request.timer is None:
            self._end(request)
        else:
            self._waiting.append(request)

    def _over(self, request: _Request) -> None:
        if request in self._waiting:
            self._stage().has_all_of(request.stamp_ns)
            self._end(request)

    def _end(self, request: _Request) -> None:
        """Answer a request from the input that has come, or refuse it."""
        if request in self._waiting:
            self._waiting.remove(request)
        instants = self._stage().instants()
        if request.stamp_ns in instants:
            family = ros_messages()
            record = self._stage().at(request.stamp_ns)
            message = to_message(record, family, self._frame_id())
            self._answer(request.header, self._response(family, instants, ok=True, skeletons=message))
        else:
            self._refuse(request.header, _why(request, instants), instants)
        executor = self._node.executor
        if request.timer is not None and executor is not None:
            executor.create_task(self._release, request.timer)  # timers belong to the executor's thread

    def _release(self, timer: OneShot) -> None:
        timer.cancel()
        self._timers -= 1

    # ------------------------------------------------------------------ answers

    def _refuse(self, header: Any, reason: str, instants: InstantRange) -> None:
        self._answer(header, self._response(ros_messages(), instants, ok=False, reason=reason))

    def _response(self, family: MessageFamily, instants: InstantRange, **fields: Any) -> Any:
        oldest, newest = family.time(instants.oldest_ns), family.time(max(instants.newest_ns, 0))
        return self._kind.Response(oldest=oldest, newest=newest, **fields)

    def _answer(self, header: Any, response: Any) -> None:
        with quiet_once(lambda: self._closed):
            self._send(response, header)


def _why(request: _Request, instants: InstantRange) -> str:
    """Return why a request is refused."""
    if instants.newest_ns < instants.oldest_ns:
        return f"no views have come yet; waited for {request.patience_s:g} s"
    if request.stamp_ns < instants.oldest_ns:
        return (
            f"the stamp is {1e-9 * (instants.oldest_ns - request.stamp_ns):.3f} s before the oldest instant"
        )
    late = 1e-9 * (request.stamp_ns - instants.newest_ns)
    return f"the stamp is {late:.3f} s after the newest instant; waited for {request.patience_s:g} s"
