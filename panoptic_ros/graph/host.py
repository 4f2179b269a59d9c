"""A part of the graph in replay: whatever arrives first, its stages take records in the order of their
places.

A host gives what comes from outside its place (`graph.lanes`) and hands it to its stages (`graph.pipeline`)
as soon as nothing can come before it. Where other hosts need to know places (`marked`), it tells those of
what it gives.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from panoptic_ros.graph.lane_groups import Group, Key
from panoptic_ros.graph.lanes import Lane
from panoptic_ros.graph.pipeline import Pipeline
from panoptic_ros.graph.schedule import DONE, Place
from panoptic_ros.graph.topics import TOPICS, number_of


class Host:
    """Stages, and the order in which they take what comes from outside.

    Args:
        pipeline: the stages. Whoever sends its records out calls `gave` after each that leaves the host.
            Ends of cameras and devices are told by the pipeline, those of whole topics by the host.
        lanes: all that comes from outside.
        marked: whether the hosts of the graph tell each other places; without, records that have none are
            taken as they come, which is the same order as long as they are of one topic.
        on_marker: called with (topic, owner, place): see `graph.lanes`.
        on_end: called with a topic when no more is given on it.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        lanes: Sequence[Lane],
        *,
        marked: bool = False,
        on_marker: Callable[[str, str, Place], None] = lambda topic, owner, place: None,
        on_end: Callable[[str], None] = lambda topic: None,
    ):
        self._pipeline, self._marked = pipeline, marked
        self._on_marker, self._on_end = on_marker, on_end
        wiring = pipeline.wiring
        self.keys = {(lane.topic, lane.owner) for lane in lanes}
        merged = [lane for lane in lanes if marked or lane.by_stamp]
        self._merged = {(lane.topic, lane.owner) for lane in merged}
        self._optional = {port.topic for port in wiring.inputs if port.optional}
        self._open_at_once = {key for key in self.keys - self._merged if key[0] not in self._optional}
        self._apart = all(spec.apart for spec in wiring.specs)
        owners = dict.fromkeys(lane.owner if self._apart else "" for lane in merged)
        self._groups = {
            owner: Group([lane for lane in merged if not self._apart or lane.owner == owner])
            for owner in owners
        }
        self._reaching = [
            frozenset(lane.topic for lane in merged if stage in wiring.reached(lane.topic))
            for stage in range(len(wiring.specs))
        ]
        self._by_markers = frozenset(lane.topic for lane in merged if not lane.by_stamp)
        self._told: dict[tuple[str, str, int], Place] = {  # topic, owner, stage: place
            (topic, owner if TOPICS[topic].scope != "graph" else "", stage): ()
            for stage, spec in enumerate(wiring.specs)
            for topic in spec.outputs
            if topic in wiring.leaving and not TOPICS[topic].by_stamp
            for owner in self._groups
        }
        self._flushed = 0
        self.over = False

    # ------------------------------------------------------------------ what comes

    def put(self, topic: str, owner: str, stamp_ns: int, record: Any) -> None:
        """A record has arrived; None: one that could not be used."""
        key = (topic, owner)
        if key not in self._merged:
            if record is not None:
                self._pipeline.push(topic, record)
            return
        self._group(owner).put(key, stamp_ns, record)

    def mark(self, topic: str, owner: str, place: Place, count: int) -> None:
        """A marker of a topic has arrived."""
        if self._marked and (topic, owner) in self._merged:
            self._group(owner).marked[topic, owner].mark(place, count)

    def end(self, topic: str, owner: str) -> None:
        """All that was sent on a lane has arrived."""
        if (topic, owner) not in self._merged:
            self._open_at_once.discard((topic, owner))
            self._pipeline.end(topic, owner)
        else:
            self._group(owner).end((topic, owner))

    def waiting_for(self) -> Key | None:
        """The lane on which something must come, or end, so that stages can go on; None: all have ended."""
        waiting = [found for group in self._groups.values() if (found := group.waiting_for()) is not None]
        return min(waiting)[3] if waiting else None

    def gave(self, topic: str, owner: str) -> None:
        """A record of these stages has left the process on a topic."""
        if self._marked and topic in self._pipeline.wiring.leaving and not TOPICS[topic].by_stamp:
            self._on_marker(topic, owner, self._pipeline.place)

    def advance(self) -> None:
        """Take all records whose turn it is, tell how far these stages have come, and end with the last
        lane.
        """
        if self.over:
            return
        for group in self._groups.values():
            group.place()
            bounds = None if self._apart else self._bounds
            limit = group.bound() if self._apart else (DONE,)
            while (item := group.take(limit)) is not None:
                self._add(*item)
                if self._apart:
                    self._pipeline.run()
            if not self._apart:
                self._pipeline.run(bounds)
        self._finish_stages()
        if self._marked:
            self._tell_bounds()

    # ------------------------------------------------------------------ helpers

    def _group(self, owner: str) -> Group:
        return self._groups[owner if self._apart else ""]

    def _add(self, place: Place, lane: Lane, record: Any, is_end: bool) -> None:
        if is_end:
            self._pipeline.add_end(lane.topic, lane.owner, place)
        elif record is not None:
            self._pipeline.schedule.add(lane.topic, record, place)

    def _bounds(self, stage: int) -> Place:
        """What a stage may still get from outside; of -1: what may come back."""
        topics = self._reaching[stage] if stage >= 0 else self._by_markers
        return min((group.bound(topics) for group in self._groups.values()), default=(DONE,))

    def _finish_stages(self) -> None:
        """Let stages that will get no more hand out what they hold, in order."""
        schedule, wiring = self._pipeline.schedule, self._pipeline.wiring
        for stage, spec in enumerate(wiring.specs):
            if not self._is_open(stage) and schedule.is_over(stage, self._bounds):
                self._pipeline.flush_stage(stage)
                self._pipeline.run(self._bounds)
                self._flushed += 1
                for topic in spec.outputs:
                    self._end_topic(stage, topic)
        self.over = self._flushed == len(wiring.specs)

    def _is_open(self, stage: int) -> bool:
        """Whether something that is taken as it comes may still come."""
        return any(stage in self._pipeline.wiring.reached(topic) for topic, _ in self._open_at_once)

    def _end_topic(self, stage: int, topic: str) -> None:
        for told, owner, giver in self._told:
            if (told, giver) == (topic, stage):
                self._told[told, owner, giver] = (DONE,)
                if self._marked:
                    self._on_marker(topic, owner, (DONE,))
        self._on_end(topic)

    def _tell_bounds(self) -> None:
        for (topic, owner, stage), told in self._told.items():
            group = self._groups[owner if self._apart else ""]
            place = group.bound() if self._apart else self._pipeline.schedule.bound(stage, self._bounds)
            if told < place < (DONE,):
                self._told[topic, owner, stage] = place
                self._on_marker(topic, owner, place)


def lanes_of(
    topics: Sequence[str],
    owners: Callable[[str], Sequence[str]],
    pipeline: Pipeline,
    clocks: Callable[[str], str] = lambda owner: "",
    shifts: Mapping[str, int] = {},
) -> list[Lane]:
    """Lanes of topics from outside.

    Args:
        topics: keys.
        owners: of a topic: the cameras or devices that give it, in the order of the rig; ("",) for the
            graph's.
        clocks: of an owner: whose clock its stamps are on; IMUs are roughly on the common one.
        shifts: by owner, or by topic where that of an owner has another: what is added to its stamps, where
            that is known; see `Lane`.
    """
    ports = {port.topic: port for port in pipeline.wiring.inputs}
    return [
        Lane(
            topic,
            owner,
            (order, number_of(topic)),
            TOPICS[topic].by_stamp,
            ports[topic].ahead_ns,
            "" if TOPICS[topic].scope == "imu" else clocks(owner),
            shifts.get(TOPICS[topic].of(owner), shifts.get(owner)),
        )
        for topic in topics
        for order, owner in enumerate(owners(topic))
    ]
