"""Listening to recordings before a run, until the clocks in them are known."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Protocol

from panoptic_ros.clocks import ClocksConfig, ClocksStage
from panoptic_ros.domain import AudioBlock, ClockModel, TimecodeReading
from panoptic_ros.errors import DataError
from panoptic_ros.params import Config, config_of
from panoptic_ros.stage import Notice
from panoptic_ros.timecode import TimecodeConfig, TimecodeStage

SECOND = 1_000_000_000
LONGEST_S = 120.0  # that is listened to
BEFORE_S = 0.5  # that a decoder needs before the first word it is to read
EARLY_S = 2.0  # of a recording that are not worth leaving out


class Heard(Protocol):
    """A device, and its sound from the beginning."""

    @property
    def device(self) -> str:
        """Its name."""

    @property
    def blocks(self) -> Callable[[], Iterator[AudioBlock]] | None:
        """What gives its sound."""


@dataclass
class Hearing:
    """What was heard.

    Args:
        models: of clocks, in master time.
        words: first reading by device and clock.
        begins: by device: the first sample that is needed; firsts: its stamp, ns.
        notices: what the stages told.
        seconds: that were listened to.
    """

    models: dict[str, ClockModel] = field(default_factory=dict)
    words: dict[tuple[str, str], TimecodeReading] = field(default_factory=dict)
    begins: dict[str, int] = field(default_factory=dict)
    firsts: dict[str, int] = field(default_factory=dict)
    notices: list[str] = field(default_factory=list)
    seconds: float = 0.0

    def told(self, notices: Sequence[Notice]) -> None:
        """Remember what a person should know."""
        self.notices += [notice.text for notice in notices if notice.severity != "info"]


def hear(recorders: Sequence[Heard], configs: Mapping[str, Config], wanted: Collection[str]) -> Hearing:
    """Listen until there are models of all wanted clocks, or all is heard.

    Raises:
        DataError: if sound cannot be read.
    """
    found = Hearing()
    timecode = TimecodeStage(config_of(configs, TimecodeConfig))
    clocks = ClocksStage(config_of(configs, ClocksConfig))
    first: dict[str, AudioBlock] = {}
    for found.seconds, block in _side_by_side(recorders):
        if set(wanted) <= found.models.keys() or found.seconds > LONGEST_S:
            break
        first.setdefault(block.device, block)
        result = timecode.step(block)
        found.told(result.notices)
        _take(found, clocks, result.outputs)
    else:
        _take(found, clocks, timecode.flush().outputs)
        found.models |= {model.device: model for model in clocks.flush().outputs}
    for device, block in first.items():
        found.begins[device] = begin = _begin(found, block)
        found.firsts[device] = block.stamp_ns + (begin - block.first_sample) * SECOND // block.sample_rate
    return found


def _take(found: Hearing, clocks: ClocksStage, readings: Sequence[TimecodeReading]) -> None:
    for reading in readings:
        found.words.setdefault((reading.device, reading.clock), reading)
        result = clocks.step(reading)
        found.told(result.notices)
        found.models |= {model.device: model for model in result.outputs}


def _begin(found: Hearing, first: AudioBlock) -> int:
    """Where to begin with a device: shortly before all of its timecodes are there."""
    words = [word.start_sample for (device, _), word in found.words.items() if device == first.device]
    begin = int(max(words, default=0.0) - BEFORE_S * first.sample_rate)
    return begin if begin - first.first_sample > EARLY_S * first.sample_rate else first.first_sample


def _side_by_side(recorders: Sequence[Heard]) -> Iterator[tuple[float, AudioBlock]]:
    """Blocks of all devices by the time since their beginnings, s."""
    for _, since, block in heapq.merge(
        *(_timed(k, recorder) for k, recorder in enumerate(recorders)), key=lambda row: (row[1], row[0])
    ):
        yield since, block


def _timed(order: int, recorder: Heard) -> Iterator[tuple[int, float, AudioBlock]]:
    blocks = iter(recorder.blocks() if recorder.blocks is not None else ())
    first = next(blocks, None)
    if first is None:
        raise DataError(f"the sound of {recorder.device} is empty")
    for block in chain([first], blocks):
        yield order, (block.first_sample - first.first_sample) / block.sample_rate, block
