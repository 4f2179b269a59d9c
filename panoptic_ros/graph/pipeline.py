"""The stages one after another in one process: the same output as the graph, without ROS.

Nothing is dropped and nothing runs at the same time; a record goes down the chain as far as it
gets before the next one is taken.
"""
from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from panoptic_ros.domain import ViewDetections
from panoptic_ros.graph.build import make_stage
from panoptic_ros.graph.nodes import FUSION, NODES
from panoptic_ros.params import Config
from panoptic_ros.stage import Notice, StageContext

Observer = Callable[[str, Any], None]  # (key of the topic, record)
NoticeObserver = Callable[[str, Notice], None]  # (stage, notice)
CHAIN = ("detection", "sync", *FUSION)


class Pipeline:
    """A chain of stages; where it has sync and `offsets.active` is set, clocks from motion go back to sync.

    What goes back waits until all that follows from the record at hand is done, so the order is fixed.

    Args:
        configs: one per stage, see `graph.build.configure`.
        stages: names of consecutive stages, by default from detection to refinement.
        on_record: called with every record that a stage gives, in order.
        on_notice: called with every notice.
        on_step: called with (stage, nanoseconds) after every step, if a clock is given.
        clock: a monotonic clock in ns; the pipeline itself reads none.
    """

    def __init__(
        self,
        configs: Mapping[str, Config],
        context: StageContext,
        stages: Sequence[str] = CHAIN,
        *,
        on_record: Observer | None = None,
        on_notice: NoticeObserver | None = None,
        on_step: Callable[[str, int], None] | None = None,
        clock: Callable[[], int] | None = None,
    ):
        self._stages = [(name, make_stage(name, configs[name], context)) for name in stages]
        self._offsets = None
        if "sync" in stages and getattr(configs["offsets"], "active", False):
            self._offsets = make_stage("offsets", configs["offsets"], context)
        self._clock_models: deque[Any] = deque()  # that wait for sync
        self._on_record = on_record or (lambda topic, record: None)
        self._on_notice = on_notice or (lambda stage, notice: None)
        self._on_step = on_step or (lambda stage, duration: None)
        self._clock = clock or (lambda: 0)

    def push(self, record: Any, to: str | None = None) -> None:
        """Hand a record to the first stage, or to the one named `to`."""
        names = [name for name, _ in self._stages]
        self._run(names.index(to) if to else 0, record)
        while self._clock_models:
            self._run(names.index("sync"), self._clock_models.popleft())

    def flush(self) -> None:
        """End of the stream: every stage hands out what it holds, in order."""
        for position, (name, stage) in enumerate(self._stages):
            self._pass_on(position, name, stage.flush())

    def _run(self, position: int, record: Any) -> None:
        name, stage = self._stages[position]
        if name == "sync" and isinstance(record, ViewDetections):
            self._find_offsets(record)
        start = self._clock()
        result = stage.step(record)
        self._on_step(name, self._clock() - start)
        self._pass_on(position, name, result)

    def _pass_on(self, position: int, name: str, result: Any) -> None:
        for notice in result.notices:
            self._on_notice(name, notice)
        for output in result.outputs:
            self._on_record(NODES[name].gives, output)
            if name == "tracking":
                self._find_offsets(output)
            if position + 1 < len(self._stages):
                self._run(position + 1, output)

    def _find_offsets(self, record: Any) -> None:
        """Hand a view or tracked people to the offsets stage."""
        if self._offsets is None:
            return
        start = self._clock()
        result = self._offsets.step(record)
        self._on_step("offsets", self._clock() - start)
        for notice in result.notices:
            self._on_notice("offsets", notice)
        for model in result.outputs:
            self._on_record(NODES["offsets"].gives, model)
            self._clock_models.append(model)


def records_of(
    topic: str,
    items: Iterable[Any],
    configs: Mapping[str, Config],
    context: StageContext,
    stages: Sequence[str] = FUSION,
) -> list[Any]:
    """All records that a fresh pipeline gives under the key of a topic, for items from first to last."""
    found: list[Any] = []
    pipeline = Pipeline(
        configs, context, stages,
        on_record=lambda key, record: found.append(record) if key == topic else None,
    )  # fmt: skip
    for item in items:
        pipeline.push(item)
    pipeline.flush()
    return found
