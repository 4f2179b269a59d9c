"""What a stage is: one object with one `step`, ignorant of threads, files, ROS and the wall clock.

The same stages run in one process (`graph.Pipeline`) and as ROS nodes (`nodes.StageNode`), with
identical output. A stage is deterministic: the same configuration and inputs give the same
outputs; time comes from the stamps of its inputs. It does not log: a `Notice` is data, and the
caller decides what to print.
"""
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Generic, Literal, Protocol, TypeVar, runtime_checkable

from panoptic_ros.domain import Rig, SkeletonModel

__all__ = ["Notice", "Stage", "StageContext", "StepResult"]

In = TypeVar("In", contravariant=True)
Out = TypeVar("Out", covariant=True)
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
