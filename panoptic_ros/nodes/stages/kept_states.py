"""Live flow: states of stages that survive a restart of their node.

A node hands over the states of its stages twice a second, and less often if they are large. The rig node
keeps the newest state of each stage. A restarted node resumes from these states, so people keep their
identities and noise tables keep what they learned. A kept state is on trial until its stage has processed a
record. A state that fails twice is not handed out again.
"""

from __future__ import annotations

import array
import time
from collections.abc import Callable, Collection, Mapping
from functools import partial
from typing import Any

from rclpy.node import Node

from panoptic_ros.nodes.middleware.family import message_class
from panoptic_ros.nodes.middleware.quality import LATCHED, NEWEST
from panoptic_ros.nodes.middleware.runtime import OneShot

PERIOD_S = 0.5
SHARE = 0.02  # largest share of the worker's time for handing over states
MOST_TRIALS = 2
EMPTY = 16  # bytes; an empty message has at most this size. It announces that a node tries the kept state.
WAITING_S = 0.3  # s; wait for kept states if a node keeps any. They come together with the rig.
SEVERAL = ("detection", "flow", "appearance")  # stages that may run in several nodes; their states are small
KIND = "std_msgs/msg/UInt8MultiArray"


def given_topic(stage: str) -> str:
    """Return the topic on which the node of a stage hands over its state."""
    return f"stages/{stage}/state"


def kept_topic(stage: str) -> str:
    """Return the latched topic on which the keeping node publishes the newest state."""
    return f"stages/{stage}/kept_state"


class StateKeeper:
    """Keeper of the newest state of each stage for restarted nodes; part of the rig node."""

    def __init__(self, node: Node, stages: Collection[str]):
        kind = message_class(KIND)
        self._publishers = {
            stage: node.create_publisher(kind, kept_topic(stage), LATCHED)
            for stage in stages
            if stage not in SEVERAL
        }
        self._kind, self._logger = kind, node.get_logger()
        self._trials = dict.fromkeys(self._publishers, 0)
        for stage in self._publishers:
            node.create_subscription(kind, given_topic(stage), partial(self._take, stage), NEWEST, raw=True)

    def _take(self, stage: str, data: bytes) -> None:
        if len(data) > EMPTY:
            self._trials[stage] = 0
            self._publishers[stage].publish(data)
            return
        self._trials[stage] += 1
        if self._trials[stage] == MOST_TRIALS:
            self._publishers[stage].publish(self._kind())
            self._logger.warning(
                f"the saved state of stage {stage} is discarded: the stage failed with it twice"
            )


class StateExchange:
    """Exchange of states with the keeper: sends the states of a node's stages, and receives kept states.

    Args:
        ask: Called at most twice a second. It calls `publish` when the states may be read.
        proven: Returns whether a stage has processed a record.
        clock: Returns the processor time of the thread, s.
    """

    def __init__(
        self,
        node: Node,
        stages: Collection[str],
        ask: Callable[[], None],
        proven: Callable[[str], bool],
        clock: Callable[[], float] = time.thread_time,
    ):
        self._node, self._ask, self._proven, self._clock = node, ask, proven, clock
        self._left_out, self._asked = 0, False  # periods to skip; whether a request is pending
        self._kept: dict[str, bytes] = {}
        self._kind = message_class(KIND)
        self._listening = {
            stage: node.create_subscription(
                self._kind, kept_topic(stage), partial(self._take, stage), LATCHED
            )
            for stage in stages
            if stage not in SEVERAL
        }
        self._publishers = {
            stage: node.create_publisher(self._kind, given_topic(stage), NEWEST) for stage in self._listening
        }
        self._begin: Callable[[Mapping[str, bytes]], None] | None = None
        self._on_trial: set[str] = set()  # stages whose trial was not announced yet
        self._waiting: OneShot | None = None
        self._timer: Any = None

    def _take(self, stage: str, message: Any) -> None:
        if len(message.data):
            self._kept[stage] = bytes(message.data)
        if self._begin is not None and self._kept.keys() == self._listening.keys():
            self._wait(0.0)  # deferred: it must not run within a subscription's callback

    def when_known(self, begin: Callable[[Mapping[str, bytes]], None]) -> None:
        """Call `begin` with the kept states as soon as all have arrived, or after `WAITING_S`.

        If no node keeps states, call it at once with none.
        """
        self._begin = begin
        if not any(self._node.count_publishers(kept_topic(stage)) for stage in self._listening):
            self._end_waiting()
            return
        self._wait(0.0 if self._kept.keys() == self._listening.keys() else WAITING_S)

    def _wait(self, seconds: float) -> None:
        if self._waiting is not None:
            self._waiting.cancel()
        self._waiting = OneShot(self._node, seconds, self._end_waiting)

    def _end_waiting(self) -> None:
        begin, self._begin = self._begin, None
        assert begin is not None
        kept, self._kept = self._kept, {}
        for subscription in self._listening.values():
            self._node.destroy_subscription(subscription)
        self._on_trial = set(kept)
        begin(kept)
        self._timer = self._node.create_timer(PERIOD_S, self._ask_for)

    def tried(self) -> None:
        """Announce the trial of kept states, because their stages are about to process a record.

        The announcement comes before the record can crash the node. It does not come earlier, because a node
        may also be killed while it waits for a record.
        """
        for stage in sorted(self._on_trial):
            if self._proven(stage) or self._publishers[stage].get_subscription_count():
                self._on_trial.discard(stage)
                if not self._proven(stage):
                    self._publishers[stage].publish(self._kind())

    def _ask_for(self) -> None:
        if self._left_out > 0:
            self._left_out -= 1
        elif not self._asked and any(p.get_subscription_count() for p in self._publishers.values()):
            self._asked = True  # a busy worker answers later
            self._ask()

    def publish(self, states: Callable[[], Mapping[str, bytes]]) -> None:
        """Hand over the states of the node's stages; a stage that is switched off has none.

        Args:
            states: Returns the states by stage.
        """
        began = self._clock()
        found = states()
        for stage in self._publishers.keys() & found.keys():
            if self._proven(stage):
                self._publishers[stage].publish(self._kind(data=array.array("B", found[stage])))
        self._asked, self._left_out = False, int((self._clock() - began) / (SHARE * PERIOD_S))
