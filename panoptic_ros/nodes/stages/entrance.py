"""What comes into a node: a message becomes a record, or is counted as what cannot be used."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

from panoptic_ros.errors import DataError, PanopticError
from panoptic_ros.graph.entrance import check_record
from panoptic_ros.graph.wiring import Wiring
from panoptic_ros.nodes.health.reports import Report
from panoptic_ros.nodes.health.tally import Tally
from panoptic_ros.nodes.stages.facts import Facts
from panoptic_ros.nodes.stages.inputs import Input, Takers
from panoptic_ros.stage import Notice

UNUSABLE = 3  # messages one after another that were refused
UNUSABLE_S = 1.0  # time that these span before a notice names the input


class Entrance:
    """Converts and checks messages; what is refused, lost or worth a notice counts for the first stage that
    takes the topic.

    Args:
        facts: rig and skeleton model, which records must fit.
        reports: what is told of records on /diagnostics, by the name of their class.
        wiring: of the node's stages.
    """

    def __init__(self, facts: Facts, tally: Tally, reports: Mapping[str, Report], wiring: Wiring):
        self._facts, self._tally, self._reports, self._wiring = facts, tally, reports, wiring
        self._refused: dict[str, list[float]] = {}  # by topic: when the messages since the last good one came

    def takers(
        self, receive: Callable[[Input, str, int, Any], None], on_record: Callable[[Any, Any], None]
    ) -> Takers:
        """Who takes what comes of an input."""
        return Takers(receive, self.refuse, self._tell, self.lost, on_record)

    def record(self, entry: Input, data: Any) -> Any | None:
        """The record of a message, None if it cannot be used."""
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
        """The first stage that takes a topic."""
        return self._wiring.specs[self._wiring.readers[topic][0].stage].name

    def refuse(self, entry: Input, error: PanopticError) -> None:
        """Count a message that cannot be used; name the input once if none of its messages can."""
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
        """So many messages of an input are gone."""
        self._tally.dropped(self.taker(entry.topic), cause, count)

    def _tell(self, entry: Input, notice: Notice) -> None:
        self._tally.tell(self.taker(entry.topic), notice)
