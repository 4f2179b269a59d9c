"""Inputs of a stage node: one for each subscribed topic of each camera or device.

Each message is converted to a record, or counted as unusable.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from rclpy.node import Node
from rclpy.parameter import Parameter

from panoptic_ros.domain import Rig
from panoptic_ros.errors import ConfigError, DataError, PanopticError
from panoptic_ros.graph.arrivals import MOST_BYTES, MOST_MESSAGES, ArrivalCounters, FloodGuard
from panoptic_ros.graph.continuity import Continuity
from panoptic_ros.graph.entrance import check_record
from panoptic_ros.graph.flow import Flow
from panoptic_ros.graph.nodes import NODES, Port
from panoptic_ros.graph.topics import TOPICS, variants
from panoptic_ros.graph.wiring import Wiring
from panoptic_ros.io.resources import share_folder
from panoptic_ros.nodes.health.reports import RecordReport
from panoptic_ros.nodes.health.tally import Tally
from panoptic_ros.nodes.middleware.decoding import (
    Decoder,
    PackedDecoder,
    audio_common_class,
    decoder_of,
    packed_decoder_of,
)
from panoptic_ros.nodes.middleware.family import message_class
from panoptic_ros.nodes.middleware.negotiation import NegotiatedSubscription
from panoptic_ros.nodes.middleware.packets import header_of, unpacked
from panoptic_ros.nodes.middleware.quality import CLOCKS, data_quality
from panoptic_ros.nodes.middleware.read_together import GatheringNode
from panoptic_ros.nodes.middleware.runtime import now_of
from panoptic_ros.nodes.stages.facts import FactsSubscriber
from panoptic_ros.params import named_words
from panoptic_ros.stage import Notice

ALL = "*"
LOSSY = 0.2  # share of lost best-effort messages above which a notice is given
PROFILE = "FASTRTPS_DEFAULT_PROFILES_FILE"
FLOODED = 128  # messages that the middleware queues while bad ones are sorted out


class InputCallbacks(NamedTuple):
    """Callbacks for the messages of an input.

    Args:
        receive: Called with (input, key of a queue, timestamp in ns, bytes of the message).
        refuse: Called for messages without a valid timestamp.
        tell: Called with notices about QoS mismatches and about topics that are paused.
        lost: Called with the cause and the number of lost messages.
        on_record: Called with each record and its message.
    """

    receive: Callable[[Input, str, int, bytes], None]
    refuse: Callable[[Input, DataError], None]
    tell: Callable[[Input, Notice], None]
    lost: Callable[[Input, str, int], None]
    on_record: Callable[[Any, Any], None]


@dataclass
class Input:
    """Subscribed topic.

    Args:
        topic: Key of the port's topic.
        carrier: Key of the subscribed topic, a variant of `topic` or `topic` itself.
        owner: Camera, sensor or device. "" for topics of the graph.
        name: Full name.
        kind: Message class.
        decode: Converts messages to records.
        arrivals: Counters of the messages.
        continuity: Check of the timestamps, if there is one.
        count: Number of processed messages.
        on_record: Called with each record and its message, if there was one.
        packed: Converts bytes to records, if that is faster.
    """

    topic: str
    carrier: str
    owner: str
    name: str
    kind: Any
    decode: Decoder
    arrivals: ArrivalCounters
    continuity: Continuity | None = None
    count: int = 0
    on_record: Callable[[Any, Any], None] = lambda record, message: None
    packed: PackedDecoder | None = None

    def record(self, data: bytes) -> Any:
        """Return the record of a message.

        Raises:
            DataError: if the message is invalid.
        """
        record = None if self.packed is None else self.packed(data)
        if record is not None:
            return record
        message = unpacked(data, self.kind)
        record = self.decode(message, self.count)
        self.on_record(record, message)
        return record

    def missing_before(self, record: Any) -> int:
        """Return the number of records that the publisher did not send before `record`."""
        number = getattr(record, "index", getattr(record, "frame_number", None))
        return 0 if number is None else self.arrivals.numbered(number)


class InputChoice:
    """Selection of a node's inputs by its parameters.

    Parameters:
        inputs.<topic>: Owners that have the topic, for every optional port of cameras or devices that no
            stage of the graph feeds.
        inputs.<variant>: Owners that send this message type ("*": all), for every other type that a port
            accepts.
        topics: Entries "<topic> <owner>=<name>" for a driver with another topic name.
        encodings: Entries "<camera>=<encoding>" for raw images whose driver states another encoding.
        devices: Audio devices.
        audio_rate, audio_channels: Values (Hz, count) for audio_common_msgs, whose messages lack them.
    """

    def __init__(self, node: Node, ports: Sequence[Port], graph: Collection[str]):
        """Declare the parameters.

        Args:
            graph: Stages that run in the graph. If a stage gives a topic for one camera, it gives it for all.
        """
        given = {topic for name in graph if name in NODES for topic in NODES[name].outputs}
        self._node, self._ports = node, ports
        self._devices = self._names("devices")
        self._renamed = named_words("topics", self._names("topics"))
        self._encodings = named_words("encodings", self._names("encodings"))
        self._optional = {
            port.topic: self._names(f"inputs.{port.topic}")
            for port in ports
            if port.optional and TOPICS[port.topic].scope != "graph" and port.topic not in given
        }
        self._variants = {
            key: self._names(f"inputs.{key}")
            for port in ports
            for key in variants(port.topic)
            if TOPICS[key].message.split("/")[0] != "audio_common_msgs"
        }
        self._sound = (16000, 1)
        if any(TOPICS[port.topic].scope == "device" for port in ports):
            self._sound = (
                int(node.declare_parameter("audio_rate", 16000).value),
                int(node.declare_parameter("audio_channels", 1).value),
            )

    def _names(self, parameter: str) -> list[str]:
        return list(self._node.declare_parameter(parameter, Parameter.Type.STRING_ARRAY).value or [])

    def owners(self, topic: str, rig: Rig) -> list[str]:
        """Return the cameras, sensors or devices that give a topic to this node, in the order of the rig."""
        scope = TOPICS[topic].scope
        known = {
            "camera": list(rig.names),
            "sensor": [sensor.name for sensor in rig.depth_sensors],
            "device": self._devices,
            "imu": self._optional.get(topic, []),
            "graph": [""],
        }[scope]
        if topic not in self._optional:
            return known
        return [owner for owner in known if owner in self._optional[topic]]

    def carriers(self, topic: str, owner: str) -> Iterator[str]:
        """Yield the topics that deliver the records of a port: one, and for audio also audio_common_msgs.

        Raises:
            ConfigError: if the parameters select several variants for one owner.
        """
        packed = [key for key in variants(topic) if {owner, ALL} & set(self._variants.get(key, ()))]
        if len(packed) > 1:
            raise ConfigError(f"{owner}: {topic} comes as {' and as '.join(packed)}; name one")
        yield packed[0] if packed else topic
        if "audio_common" in variants(topic) and audio_common_class() is not None:
            yield "audio_common"

    def name(self, carrier: str, owner: str) -> str:
        """Return the name of a topic of an owner."""
        return self._renamed.get(f"{carrier} {owner}".strip(), TOPICS[carrier].of(owner))

    def decoder(self, carrier: str, owner: str, tell: Callable[[str], None] | None) -> Decoder:
        """Return the decoder of a topic; see `middleware.decoding`."""
        return decoder_of(carrier, owner, *self._sound, self._encodings.get(owner, ""), tell)


def subscribe(
    node: GatheringNode, choice: InputChoice, topic: str, owner: str, flow: Flow, takers: InputCallbacks
) -> list[Input]:
    """Subscribe to a topic of a camera or device; return its inputs."""
    return [
        _subscribe(node, choice, topic, carrier, owner, flow, takers)
        for carrier in choice.carriers(topic, owner)
    ]


def _subscribe(
    node: GatheringNode,
    choice: InputChoice,
    topic: str,
    carrier: str,
    owner: str,
    flow: Flow,
    takers: InputCallbacks,
) -> Input:
    row, live = TOPICS[carrier], flow.name == "live"
    frequent = row.scope in ("device", "imu")
    images, sound = row.record in ("ViewFrame", "DepthFrame"), row.scope == "device"
    quality = CLOCKS if row.latched else data_quality(flow, images=images, sound=frequent)
    if live and row.scope == "graph" and not row.latched:
        quality.depth = FLOODED
    is_guarded = live and row.scope != "graph"
    guard = FloodGuard(0 if sound else MOST_MESSAGES, MOST_BYTES if carrier == "detections" else 0)

    def take(data: bytes, sequence: int) -> None:
        now_ns, lost = time.monotonic_ns(), arrivals.lost
        flood = guard.came(now_ns, len(data), arrivals.bad) if is_guarded else ""
        try:
            stamp_ns, frame_id = header_of(data)
        except DataError as error:
            arrivals.came(now_ns, sequence)
            takers.refuse(found, error)
        else:
            latency = now_of(node) - stamp_ns if live and not row.latched else None
            arrivals.came(now_ns, sequence, latency)
            odd = found.continuity.judge(stamp_ns, now_ns) if found.continuity is not None else ""
            if odd:
                takers.lost(found, odd, 1)
                return
            # one queue per frame_id: devices on a shared latched topic must not displace each other
            queue = f"{topic} of {frame_id}" if row.latched else f"{topic} {owner}".strip()
            takers.receive(found, queue, stamp_ns, data)
        if arrivals.lost > lost:
            takers.lost(found, "lost", arrivals.lost - lost)
            if not subscription.is_reliable and arrivals.lost_share() > LOSSY:
                takers.tell(found, lossy(arrivals, len(data)))
        if flood:
            leave_alone(flood, now_ns)

    def leave_alone(why: str, now_ns: int) -> None:
        seconds = 1e-9 * guard.pause(now_ns)
        arrivals.paused = f"{arrivals.title}: {why} came; its messages are ignored for {seconds:g} s"
        subscription.pause(seconds, resume)
        values = {"camera": owner}
        takers.tell(found, Notice("graph.flood", "warning", arrivals.paused, values))

    def resume() -> None:
        arrivals.paused = ""

    def tell_encoding(text: str) -> None:
        takers.tell(found, Notice("graph.encoding", "warning", text, {"device": owner}))

    subscription = NegotiatedSubscription(
        node,
        message_class(row.message),
        choice.name(carrier, owner),
        take,
        quality,
        gives_way=live and not row.latched,
        tell=lambda notice: takers.tell(found, notice),
        together=node.together if live and row.scope == "imu" else None,
    )
    name = subscription.topic_name
    arrivals = ArrivalCounters(topic, owner, name, _is_regular(topic, carrier), time.monotonic_ns())
    decoder = choice.decoder(carrier, owner, tell_encoding if live else None)
    in_order = live and row.scope == "graph" and not row.latched
    found = Input(
        topic,
        carrier,
        owner,
        name,
        message_class(row.message),
        decoder,
        arrivals,
        Continuity() if in_order else None,
        on_record=takers.on_record,
        packed=packed_decoder_of(carrier, owner),
    )
    return found


def lossy(arrivals: ArrivalCounters, size: int) -> Notice:
    """Return a notice about a best-effort driver that loses many messages, with the remedy.

    The driver's middleware has small buffers, or it splits images into datagrams, as is needed between
    machines. On one machine the driver should use the transport profile of this graph.
    """
    profile = os.environ.get(PROFILE) or share_folder() / "config" / "fastdds.xml"
    text = (
        f"{100 * arrivals.lost_share():.0f} % of {arrivals.name} ({size / 1e6:.2g} MB each) is lost on the "
        f"way, as its driver offers best effort: start the driver with {PROFILE}={profile}, or let it offer "
        "reliable, or smaller or fewer images"
    )
    return Notice("graph.lossy", "warning", text, {"camera": arrivals.owner})


def _is_regular(topic: str, carrier: str) -> bool:
    """Return whether messages come at a rate, so that their absence is an outage.

    Audio comes on one of two topics, so a silent audio topic is not an outage.
    """
    return not TOPICS[topic].latched and topic not in ("timecode", "audio") and carrier != "audio_common"


UNUSABLE = 3  # refused messages in a row
UNUSABLE_S = 1.0  # s, minimum span of UNUSABLE refused messages before a notice names the input


class MessageValidator:
    """Converter and validator of messages.

    Refusals, losses and notices count for the first stage that takes the topic.

    Args:
        facts: Rig and skeleton model, which records must fit.
        reports: Receivers of records for /diagnostics, by record class name.
        wiring: Connections of the node's stages.
    """

    def __init__(
        self, facts: FactsSubscriber, tally: Tally, reports: Mapping[str, RecordReport], wiring: Wiring
    ):
        self._facts, self._tally, self._reports, self._wiring = facts, tally, reports, wiring
        # by topic: monotonic times of refused messages since the last good one, s
        self._refused: dict[str, list[float]] = {}

    def takers(
        self, receive: Callable[[Input, str, int, Any], None], on_record: Callable[[Any, Any], None]
    ) -> InputCallbacks:
        """Return the callbacks for the messages of an input."""
        return InputCallbacks(receive, self.refuse, self._tell, self.lost, on_record)

    def record(self, entry: Input, data: Any) -> Any | None:
        """Return the record of a message; None if it is unusable."""
        try:
            record = entry.record(data)
            check_record(record, entry.owner, self._facts.rig, self._facts.skeleton)
        except DataError as error:
            self.refuse(entry, error)
            return None
        self._refused.pop(entry.name, None)
        entry.missing_before(record)
        if entry.continuity is not None:
            entry.continuity.used(record.stamp_ns, time.monotonic_ns())
        report = self._reports.get(type(record).__name__)
        if report is not None:
            report.take(record)
        return record

    def taker(self, topic: str) -> str:
        """Return the first stage that takes a topic."""
        return self._wiring.specs[self._wiring.readers[topic][0].stage].name

    def refuse(self, entry: Input, error: PanopticError) -> None:
        """Count an unusable message; give one notice about the input if none of its messages is usable."""
        entry.arrivals.bad += 1
        self._tally.refuse(self.taker(entry.topic), error)
        times = self._refused.setdefault(entry.name, [])
        times.append(time.monotonic())
        if len(times) == UNUSABLE and times[-1] - times[0] < UNUSABLE_S:
            times.pop()
        elif len(times) == UNUSABLE:
            text = f"no {entry.arrivals.title} can be used: {error}"
            self._tell(entry, Notice("graph.unusable", "warning", text, {"device": entry.owner}))
        del times[UNUSABLE + 1 :]

    def lost(self, entry: Input, cause: str, count: int) -> None:
        """Count lost messages of an input."""
        self._tally.dropped(self.taker(entry.topic), cause, count)

    def _tell(self, entry: Input, notice: Notice) -> None:
        self._tally.tell(self.taker(entry.topic), notice)
