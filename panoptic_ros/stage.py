"""What a stage is: one object with one `step`, ignorant of threads, files, ROS and the wall clock.

The same stages run in one process (`graph.Pipeline`) and as ROS nodes (`nodes.StageNode`), with
identical output. A stage is deterministic: the same configuration and inputs give the same
outputs; time comes from the stamps of its inputs. It does not log: a `Notice` is data, and the
caller decides what to print.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Generic, Literal, Protocol, TypeVar, runtime_checkable

from panoptic_ros.domain import Rig, SkeletonModel

__all__ = [
    "Notice",
    "Pass",
    "Progress",
    "Punctual",
    "Recording",
    "Resting",
    "Stage",
    "StageContext",
    "StepResult",
    "Timed",
    "each",
    "part_of",
    "untold",
]

In = TypeVar("In", contravariant=True)
Out = TypeVar("Out", covariant=True)
Artefact = TypeVar("Artefact", covariant=True)
Item = TypeVar("Item")
Severity = Literal["info", "warning", "error"]


@dataclass(frozen=True)
class Notice:
    """Something that a person may want to know; `code` is stable, e.g. "sync.late_frame"."""

    code: str
    severity: Severity
    text: str
    values: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class StepResult(Generic[Out]):
    """What a step gives: any number of records, and notices."""

    outputs: tuple[Out, ...] = ()
    notices: tuple[Notice, ...] = ()


@dataclass(frozen=True)
class StageContext:
    """What every stage may know about the capture besides its own configuration."""

    rig: Rig
    skeleton: SkeletonModel
    extras: Mapping[str, Any] = field(default_factory=dict)  # "detector": a loaded model, ...


@runtime_checkable
class Stage(Protocol[In, Out]):
    """Constructed as `SomeStage(config, context)`."""

    def step(self, item: In) -> StepResult[Out]:
        """Take one record. Bad content raises DataError and leaves the state unchanged."""

    def flush(self) -> StepResult[Out]:
        """End of the stream: hand out all that is buffered. The stage is then as new."""

    def reset(self) -> None:
        """Forget everything, as if just constructed."""

    def forget(self) -> None:
        """Forget what was measured, in a graph that goes on: what others rely on lasts, such as ids."""

    def state(self) -> bytes:
        """All that later steps depend on; the stage is unchanged."""

    def begin(self, state: bytes) -> None:
        """Replace all of the stage's own state by what `state` gave, of a stage of this class and context.

        Raises:
            DataError: if the bytes are not whole, or of another stage, version, configuration or context; the
                stage is then unchanged.
        """


@runtime_checkable
class Resting(Protocol):
    """A stage whose state is large because of what only the next moments need."""

    def lasting_state(self) -> bytes:
        """What counts after a pause, in the form of `state`: who begins with it goes on as after one."""


@runtime_checkable
class Punctual(Protocol):
    """A stage that does less when it is late. What it gives depends on the machine then, so only a live graph
    tells it."""

    def waited(self, ns: int) -> None:
        """The records that come next have waited for so long."""


@runtime_checkable
class Timed(Protocol):
    """A stage that compares stamps with the time of arrival. Only a live graph has one and tells it."""

    def arrived(self, came_ns: int, host_ns: int) -> None:
        """Take the arrival of the records that come next.

        Args:
            came_ns: on a monotonic clock. host_ns: the same moment on the clock that stamps of cameras
                should be on.
        """


# Passes: what needs a whole recording.

Progress = Callable[[float, str], None]
"""Is told the share that is done, 0..1, and what is being done."""


class Recording(Protocol):
    """The records of a capture, which can be read as often as one likes."""

    def records(
        self, topic: str, scope: str = "", begin_ns: int | None = None, end_ns: int | None = None
    ) -> Iterable[Any]:
        """Records of one topic in the order of their stamps.

        Args:
            topic: its key in `graph.topics.TOPICS`, or "truth" for `evaluation.SkeletonFrame`s.
            scope: the camera or device, for topics that have one.
            begin_ns, end_ns: only stamps from the first and before the second one; None = all.
        """


@runtime_checkable
class Pass(Protocol[Artefact]):
    """Constructed as `SomePass(config, context)`.

    Deterministic as a stage is, and without state: a run leaves nothing behind for the next one.
    """

    def run(self, recording: Recording, progress: Progress) -> Artefact:
        """Read the recording and return what was to be found: clocks, a table, scores, motion.

        A pass writes no files, so an interruption leaves nothing that is half-written.

        Args:
            progress: is called between steps, with shares that never go back and end at 1. What it
                raises interrupts the pass.
        """


def untold(share: float, doing: str) -> None:
    """Progress that nobody wants to know."""


def part_of(progress: Progress, begin: float, end: float) -> Progress:
    """Progress of a part of some work: its 0..1 are `begin`..`end` of the whole."""
    return lambda share, doing: progress(min(end, begin + (end - begin) * share), doing)


def each(items: Iterable[Item], count: int, progress: Progress, doing: str) -> Iterator[Item]:
    """The items, `count` in number, with progress before each of them and after the last."""
    for done, item in enumerate(items):
        progress(done / count, doing)
        yield item
    progress(1.0, doing)
