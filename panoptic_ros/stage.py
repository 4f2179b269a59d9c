"""Defines the interface of stages and passes.

A stage is one object with one `step`. It does not depend on threads, files, ROS or the wall clock. The same
stages run in one process (`graph.Pipeline`) and as ROS nodes (`nodes.StageNode`), with identical output. A
stage is deterministic: the same configuration and inputs give the same outputs. Time comes from the
timestamps of its inputs. A stage does not log: a `Notice` is data, and the caller decides what to print. A
pass is an algorithm that needs a whole recording.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Generic, Literal, Protocol, TypeVar, runtime_checkable

from panoptic_ros.domain import Rig, SkeletonModel

__all__ = [
    "ArrivalAwareStage",
    "IdleWorkStage",
    "InstantRange",
    "LastingStateStage",
    "LatenessAwareStage",
    "Notice",
    "Pass",
    "Progress",
    "Recording",
    "RequestStage",
    "Stage",
    "StageContext",
    "StepResult",
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
    """Message for the user.

    Args:
        code: stable code, e.g. "sync.late_frame".
        values: values in the text, for programs.
    """

    code: str
    severity: Severity
    text: str
    values: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class StepResult(Generic[Out]):
    """Result of a step: any number of records, and notices."""

    outputs: tuple[Out, ...] = ()
    notices: tuple[Notice, ...] = ()


@dataclass(frozen=True)
class StageContext:
    """Information about the capture that every stage may use, in addition to its own configuration."""

    rig: Rig
    skeleton: SkeletonModel
    extras: Mapping[str, Any] = field(default_factory=dict)  # "detector": a loaded model, ...


@runtime_checkable
class Stage(Protocol[In, Out]):
    """Stage of the pipeline, constructed as `SomeStage(config, context)`."""

    def step(self, item: In) -> StepResult[Out]:
        """Process one record and return the results.

        Raises:
            DataError: on bad content. The state is then unchanged.
        """

    def flush(self) -> StepResult[Out]:
        """End the stream: return everything that is buffered. The stage is then as newly constructed."""

    def reset(self) -> None:
        """Reset the stage to its state after construction."""

    def forget(self) -> None:
        """Discard the measurements while the graph continues.

        The stage keeps the state that other stages rely on, such as ids.
        """

    def state(self) -> bytes:
        """Return everything that later steps depend on, as bytes. The stage is unchanged."""

    def begin(self, state: bytes) -> None:
        """Replace the stage's own state by a result of `state` from a stage of this class and context.

        Raises:
            DataError: if the bytes are incomplete, or belong to another stage, version, configuration or
                context. The stage is then unchanged.
        """


@runtime_checkable
class LastingStateStage(Protocol):
    """Stage whose state is large because of data that only the next few steps need."""

    def lasting_state(self) -> bytes:
        """Return the state that matters after a pause, in the form of `state`.

        A stage that begins with it continues as after a pause.
        """


@runtime_checkable
class LatenessAwareStage(Protocol):
    """Stage that does less work when it is late.

    Its output then depends on the machine. So only a live graph reports the delay to it.
    """

    def waited(self, ns: int) -> None:
        """Receive the waiting time, ns, of the next records."""


@runtime_checkable
class ArrivalAwareStage(Protocol):
    """Stage that compares timestamps with arrival times.

    Only a live graph has arrival times and reports them.
    """

    def arrived(self, came_ns: int, host_ns: int) -> None:
        """Receive the arrival time of the next records.

        Args:
            came_ns: arrival time on a monotonic clock, ns.
            host_ns: the same moment on the clock that should timestamp the cameras, ns.
        """


@runtime_checkable
class IdleWorkStage(Protocol):
    """Stage with work that later steps need, but not the results of the current step."""

    def settle(self) -> None:
        """Do that work, after the results were passed on. If nobody calls it, the next step does the work."""


@dataclass(frozen=True)
class InstantRange:
    """Instants for which a stage can give records, ns; none if the newest is before the oldest."""

    oldest_ns: int
    newest_ns: int

    def __contains__(self, stamp_ns: int) -> bool:
        return self.oldest_ns <= stamp_ns <= self.newest_ns


@runtime_checkable
class RequestStage(Protocol):
    """Stage that also gives records for requested instants, without an effect on its other output."""

    def instants(self) -> InstantRange:
        """Return the instants that may be requested now."""

    def has_all_of(self, stamp_ns: int) -> bool:
        """Return whether all input that an instant (ns) needs has come."""

    def at(self, stamp_ns: int) -> Any:
        """Return the record of an instant (ns) in `instants`, from the input that has come."""

    def before_output(self, look: Callable[[], None]) -> None:
        """Call a function in each step once the input has been taken, before other output is computed.

        The function may call the methods above. A step that gives no other output need not call it.
        """


# Passes: algorithms that need a whole recording.

Progress = Callable[[float, str], None]
"""Is told the share that is done, 0..1, and what is being done."""


class Recording(Protocol):
    """Records of a capture, which can be read any number of times."""

    def records(
        self, topic: str, scope: str = "", begin_ns: int | None = None, end_ns: int | None = None
    ) -> Iterable[Any]:
        """Return the records of one topic in the order of their timestamps.

        Args:
            topic: key in `graph.topics.TOPICS`, or "truth" for `evaluation.SkeletonFrame`s.
            scope: camera or device, for topics that have one.
            begin_ns, end_ns: only timestamps from `begin_ns` on and before `end_ns`; None = no limit.
        """


@runtime_checkable
class Pass(Protocol[Artefact]):
    """Algorithm over a whole recording, constructed as `SomePass(config, context)`.

    It is deterministic, as a stage is, and has no state: a run does not affect the next one.
    """

    def run(self, recording: Recording, progress: Progress) -> Artefact:
        """Read the recording and return the result: clocks, a table, scores, motion.

        A pass writes no files, so an interruption leaves no incomplete files.

        Args:
            progress: callback between steps, with shares that never decrease and end at 1. An exception that
                it raises interrupts the pass.
        """


def untold(share: float, doing: str) -> None:
    """Ignore the progress."""


def part_of(progress: Progress, begin: float, end: float) -> Progress:
    """Return a progress callback for a part of a task. Its range 0..1 maps to `begin`..`end` of the task."""
    return lambda share, doing: progress(min(end, begin + (end - begin) * share), doing)


def each(items: Iterable[Item], count: int, progress: Progress, doing: str) -> Iterator[Item]:
    """Yield the items, and report progress before each item and after the last one.

    Args:
        count: number of items.
        doing: text about the work, for `progress`.
    """
    for done, item in enumerate(items):
        progress(done / count, doing)
        yield item
    progress(1.0, doing)
