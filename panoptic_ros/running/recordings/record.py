"""Records a live graph into self-contained bags.

It reports the disk budget at the start and counters at the end.
"""

from __future__ import annotations

import platform
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rclpy.utilities import try_shutdown

from panoptic_ros.domain import Rig
from panoptic_ros.errors import EnvironmentProblem, PanopticError
from panoptic_ros.graph.topics import TOPICS, ros_name
from panoptic_ros.io.bag_connections import Connection
from panoptic_ros.io.bag_recorder import BagRecorder, TopicCounter
from panoptic_ros.io.bag_split import GB
from panoptic_ros.io.definitions import described
from panoptic_ros.io.interruption import first_request_told, requests_held
from panoptic_ros.io.messages import bag_messages, to_message
from panoptic_ros.io.messages.family import bag_typestore
from panoptic_ros.io.rigs import read_rig
from panoptic_ros.io.takes import OpenTake
from panoptic_ros.nodes.listeners.recorder_node import RecorderNode
from panoptic_ros.nodes.middleware.family import service_class
from panoptic_ros.nodes.middleware.runtime import make_executor, start_ros
from panoptic_ros.running.recordings.control import PREFIX, SERVICE, prepare_recording
from panoptic_ros.running.recordings.facts import as_text, recording_facts
from panoptic_ros.running.recordings.options import RecordOptions, told_room
from panoptic_ros.running.takes import named_unclosed_takes

FACTS, COUNTERS = "/recording/facts", "/recording/counters"
STRING = "std_msgs/msg/String"
PATIENCE_S = 10.0  # s, timeout for the first topic
# s at the start of a recording. The data rates in this time determine the recording time that fits on the
# disk.
MEASURED_S = 2.0
SETTLE_S = 1.0  # s until the nodes of a graph have discovered the recorder, as measured for `claim_domain`


@dataclass(frozen=True)
class RecordResult:
    """Result of a recording.

    Args:
        path: Path of the bag.
        counters: Counters by topic.
        dropped: Messages by topic that were dropped because the disk was too slow.
        ended_by: One line about the cause of an early end; "" = none.
    """

    path: Path
    counters: Mapping[str, TopicCounter]
    dropped: Mapping[str, int]
    ended_by: str = ""


def record(path: Path, options: RecordOptions, tell: Callable[[str], None]) -> RecordResult:
    """Record until a request to end, or until the duration or the disk space is used up.

    Args:
        tell: callback with lines for the user, such as the budget and topics that are left out.

    Raises:
        EnvironmentProblem: if nothing is published, or the requested duration does not fit on the disk. In
            the latter case, the bag ends after `MEASURED_S`.
    """
    with first_request_told() as asked, _BagRecording(options, tell) as recording:
        recording.wait(asked)
        if asked():
            raise KeyboardInterrupt
        recording.begin(path)
        recording.spin(asked, options.duration_s)
        with requests_held():
            return recording.end()


def stand_by(folder: Path, options: RecordOptions, tell: Callable[[str], None]) -> None:
    """Record on request of the service, a new bag each time, until the program is asked to end."""
    with first_request_told() as asked, _BagRecording(options, tell) as recording:
        recording.serve(folder)
        tell(f"waiting: `panoptic record --start`, or service {recording.service_name}")
        recording.spin(asked, None)
        recording.end()


class _BagRecording:
    """Recorder node with its current bag."""

    def __init__(self, options: RecordOptions, tell: Callable[[str], None]):
        self._options, self._tell = options, tell
        self._bag: BagRecorder | None = None
        self._path, self._begun_s = Path(), 0.0
        self._room_told: BagRecorder | None = None  # bag whose possible recording time was reported already
        self._take: OpenTake | None = None  # open-take mark of the current bag
        self._facts = ""
        self._rig: Rig | None = None if options.rig is None else read_rig(options.rig)
        self._wish: Path | None = None  # path of a requested bag that has not begun yet
        self._unwished = False  # whether the requested bag must end as soon as it has begun
        self._last = ""  # line about the result of the last bag
        self._folder: Path | None = None  # folder of bags that the service requests
        self._service: Any = None
        prepare_recording()
        start_ros([])
        self._node = RecorderNode(
            PREFIX + ros_name(platform.node() or "host"), options.selection.wants, self._put, tell
        )
        self._executor = make_executor()
        self._executor.add_node(self._node)

    @property
    def service_name(self) -> str:
        """Return the full name of the service."""
        return f"{self._node.get_fully_qualified_name()}/{SERVICE}"

    def wait(self, stop: Callable[[], bool]) -> None:
        """Wait for the first topic.

        Raises:
            EnvironmentProblem: if nothing is published.
        """
        deadline = time.monotonic() + PATIENCE_S
        while not self._node.topics and time.monotonic() < deadline and not stop():
            self._executor.spin_once(timeout_sec=0.05)
        if not self._node.topics and not stop():
            raise EnvironmentProblem(
                "no node publishes a topic to record: is the graph running, in this ROS_DOMAIN_ID? "
                "`--topic PATTERN` chooses other topics"
            )

    def begin(self, path: Path) -> None:
        """Begin a bag: write the latched messages, then the facts about the graph as its nodes answer."""
        options = self._options
        self._facts = ""
        bag = BagRecorder(
            path,
            round(options.budget_gb * GB),
            round(options.keep_free_gb * GB),
            options.split,
            self._opening,
        )
        now = self._node.get_clock().now().nanoseconds
        for connection, data in self._opening():
            bag.put(connection, now, data)
        self._path, self._bag, self._begun_s = path, bag, time.monotonic()
        self._take = OpenTake(path)
        self._tell(f"recording {path}")
        for line in named_unclosed_takes():
            self._tell(f"warning: {line}")
        settled = time.monotonic() + SETTLE_S
        while time.monotonic() < settled:  # receives messages meanwhile, until all nodes are discovered
            self._executor.spin_once(timeout_sec=0.05)
        self._facts = as_text(recording_facts(self._node, self._executor))
        bag.put(_text_topic(FACTS), self._node.get_clock().now().nanoseconds, _text(self._facts))

    def _opening(self) -> list[tuple[Connection, bytes]]:
        """Return the first messages of every bag: the facts about the graph, and the latched messages."""
        found = [(_text_topic(FACTS), _text(self._facts))] if self._facts else []
        rig = "/" + TOPICS["rig"].name
        if self._rig is not None and rig not in self._node.topics:
            message = to_message(self._rig, bag_messages())
            connection = described(rig, message.__msgtype__)
            assert connection is not None  # a message type of this package
            found.append((connection, bytes(bag_typestore().serialize_cdr(message, message.__msgtype__))))
        return found + self._node.latched

    def spin(self, stop: Callable[[], bool], duration_s: float | None) -> None:
        """Receive messages until a request to end, or until the bag ends early."""
        begin = self._begun_s if self._bag is not None else time.monotonic()
        while not stop() and (duration_s is None or time.monotonic() < begin + duration_s):
            self._executor.spin_once(timeout_sec=0.1)
            self._tell_room()
            if self._wish is not None:
                self._begin_wish(self._wish)
            if self._bag is not None and self._bag.fault is not None:
                if self._folder is None:
                    return
                self._tell(str(self._bag.fault))
                self._end_told()  # closes the bag; the returned line would repeat the fault

    def _tell_room(self) -> None:
        """Report once per bag how much recording time the disk has room for.

        Raises:
            EnvironmentProblem: if the requested duration does not fit.
        """
        bag = self._bag
        seconds = time.monotonic() - self._begun_s
        if bag is None or self._room_told is bag or seconds < MEASURED_S:
            return
        self._room_told = bag
        rates = {name: c.size / seconds for name, c in dict(bag.counters).items() if name != FACTS}
        line = told_room(self._path, rates, self._options)
        if self._folder is None:
            self._tell(line)

    def _begin_wish(self, path: Path) -> None:
        """Begin the bag that the service requested.

        The request stays pending until the bag exists, so that no second bag begins meanwhile.
        """
        try:
            self.begin(path)
            if self._unwished:
                self._tell(self._end_told())
        except PanopticError as error:  # the next request may succeed
            self._tell(str(error))
        finally:
            self._wish = None

    def _end_told(self) -> str:
        """End the bag; return one line with its result or its error. Standby continues."""
        try:
            self._last = _stopped(self.end())
        except PanopticError as error:
            self._last = str(error)
        return self._last

    def end(self) -> RecordResult:
        """Complete the bag, if there is one.

        Raises:
            PanopticError: if it cannot be completed.
        """
        bag, self._bag = self._bag, None
        take, self._take = self._take, None
        if bag is None:
            return RecordResult(self._path, {}, {})
        counters = {topic: c for topic, c in bag.counters.items() if topic not in (FACTS, COUNTERS)}
        document = {
            topic: {
                "count": c.count,
                "bytes": c.size,
                "missing": c.missing,
                "longest_s": c.longest_s,
                "rate_hz": c.rate,
                "dropped": bag.dropped[topic],
            }
            for topic, c in counters.items()
        }
        if bag.fault is None:
            bag.put(_text_topic(COUNTERS), self._node.get_clock().now().nanoseconds, _text(as_text(document)))
        _close(bag, take)
        return RecordResult(self._path, counters, dict(bag.dropped), str(bag.fault or ""))

    # ------------------------------------------------------------- service

    def serve(self, folder: Path) -> None:
        """Offer the service that starts and stops recordings in `folder`."""
        self._folder = folder
        self._service = self._node.create_service(
            service_class("std_srvs/srv/SetBool"), f"~/{SERVICE}", self._asked
        )

    def _asked(self, request: Any, response: Any) -> Any:
        """Answer a service request. Success means that the requested state holds.

        A client that lost an answer may ask again and gets the same answer.
        """
        response.success = True
        if request.data and self._bag is None and self._wish is None and self._folder is not None:
            self._unwished = False
            self._wish = _free(self._folder / time.strftime("%Y%m%d-%H%M%S", time.gmtime()))
            response.message = f"recording {self._wish.resolve()}"
        elif request.data:
            response.message = f"recording {(self._wish or self._path).resolve()} already"
        elif self._wish is not None:
            self._unwished = True
            response.message = f"{self._wish} ends as soon as it has begun"
        elif self._bag is not None:
            response.message = self._end_told()
            self._tell(response.message)
        else:
            response.message = self._last or "was not recording"
        return response

    # ------------------------------------------------------------- messages

    def _put(self, connection: Connection, stamp_ns: int, data: bytes) -> None:
        if self._bag is not None:
            self._bag.put(connection, stamp_ns, data)

    def __enter__(self) -> _BagRecording:
        return self

    def __exit__(self, *exception: object) -> None:
        if self._bag is not None:  # after an error the recorded data stay, for `panoptic bag repair`
            try:
                _close(self._bag, self._take)
            except PanopticError as error:
                self._tell(str(error))
        self._executor.shutdown()
        self._node.destroy_node()
        try_shutdown()


def _close(bag: BagRecorder, take: OpenTake | None) -> None:
    """Close a bag, and remove the marker file of its take.

    If the bag cannot be closed, the marker file stays: the take is incomplete.
    """
    try:
        bag.close()
    except PanopticError as error:
        if take is not None:
            take.leave()
        raise type(error)(
            f"{error}; the bag is not closed, `panoptic bag repair {bag.path}` saves its intact part"
        ) from None
    if take is not None:
        take.close()


def _free(path: Path) -> Path:
    """Return the path, or an unused path beside it. Two bags may begin within one second."""
    found, number = path, 1
    while found.exists():
        number += 1
        found = path.with_name(f"{path.name}-{number}")
    return found


def _stopped(recorded: RecordResult) -> str:
    count = sum(c.count for c in recorded.counters.values())
    missing = sum(c.missing for c in recorded.counters.values())
    ended_by = f" ({recorded.ended_by})" if recorded.ended_by else ""
    return f"{recorded.path}: {count} messages, {missing} did not come{ended_by}"


def _text_topic(topic: str) -> Connection:
    connection = described(topic, STRING)
    assert connection is not None  # a message type of ROS itself
    return connection


def _text(text: str) -> bytes:
    store = bag_typestore()
    return bytes(store.serialize_cdr(store.types[STRING](data=text), STRING))
