"""What a study simulates and by what it is solved, and how its progress is shared out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import accumulate
from typing import Any

from panoptic_ros.stage import Progress, part_of

Settings = Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True)
class Takes:
    """One take for each number of people.

    Args:
        frames: of each. noise: of 2D joints, a share of the diagonal of a person's box.
    """

    people: tuple[int, ...]
    frames: int
    seed: int = 0
    noise: float = 0.012


@dataclass(frozen=True)
class Method:
    """A way to solve.

    Args:
        settings: parameters; those of `solving.ALONE` count where these say nothing.
        skeleton: its name or YAML file, "" = that of the recording.
    """

    name: str = "default"
    settings: Settings = field(default_factory=dict)
    skeleton: str = ""


def shared_out(progress: Progress, costs: Sequence[float]) -> list[Progress]:
    """Progress of each of several parts, whose shares of the whole are as their costs."""
    ends = [sum_ / sum(costs) for sum_ in accumulate(costs)]
    return [part_of(progress, begin, end) for begin, end in zip([0.0, *ends], ends)]


def of_people(people: int, progress: Progress) -> Progress:
    """Progress that also says how many people are at hand."""
    return lambda share, doing: progress(share, f"{people} people: {doing}")
