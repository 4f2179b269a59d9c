"""A run in one process, without ROS: the same stages, the same results."""
from __future__ import annotations

import heapq
import queue
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from panoptic_ros.capture import open_capture_folder, open_files, open_live
from panoptic_ros.cli.run.plan import Plan
from panoptic_ros.cli.run.results import Results
from panoptic_ros.domain import EndOfStream
from panoptic_ros.errors import PanopticError
from panoptic_ros.graph.counters import StageStatistics
from panoptic_ros.graph.nodes import NODES
from panoptic_ros.graph.pipeline import CHAIN, Pipeline
from panoptic_ros.io.bags import BagReader
from panoptic_ros.io.messages import frame_from_message, from_message
from panoptic_ros.stage import Notice, StageContext


def run_in_process(plan: Plan, results: Results, stop: Any) -> dict[str, StageStatistics]:
    """Run the plan to its end, or until `stop()` is true; returns what each stage counted."""
    stages = CHAIN[CHAIN.index(plan.stage) :]
    statistics = {name: StageStatistics() for name in stages}

    def note(stage: str, notice: Notice) -> None:
        statistics[stage].notices[notice.code] += 1

    def record(key: str, item: Any) -> None:
        name = next(name for name in stages if NODES[name].gives == key)
        statistics[name].given += 1
        results.take(key, item)

    def step(stage: str, duration_ns: int) -> None:
        statistics[stage].taken += 1
        statistics[stage].add_duration(duration_ns)

    context = StageContext(plan.rig, plan.skeleton, plan.extras)
    pipeline = Pipeline(
        plan.configs, context, stages, on_record=record, on_notice=note, on_step=step,
        clock=time.perf_counter_ns,
    )  # fmt: skip
    for item in _items(plan):
        if stop():
            break
        if isinstance(item, EndOfStream):
            pipeline.push(item, to="sync")
        else:
            if plan.stage == "sync":
                results.take("detections", item)
            pipeline.push(item)
    pipeline.flush()
    return statistics


def _items(plan: Plan) -> Iterator[Any]:
    """Frames or detections of all cameras, and the end of each: by stamp, or live as they come."""
    if plan.live:
        yield from _as_they_come(plan)
        return
    streams = [_numbered(order, stream) for order, stream in enumerate(_streams(plan))]
    for _, _, item in heapq.merge(*streams, key=lambda row: row[:2]):
        yield item


def _as_they_come(plan: Plan) -> Iterator[Any]:
    """Each device in a thread of its own; they hand over their newest frames, one at a time."""
    waiting: queue.Queue[Any] = queue.Queue(maxsize=1)
    over = threading.Event()

    def read(camera: str) -> None:
        try:
            for item in _frames(plan, camera):
                while not over.is_set():
                    with suppress(queue.Full):
                        waiting.put(item, timeout=0.2)
                        break
                if over.is_set():
                    return
        except PanopticError as error:
            waiting.put(error)

    threads = [threading.Thread(target=read, args=(name,), daemon=True) for name in plan.rig.names]
    for thread in threads:
        thread.start()
    try:
        ended = 0
        while ended < len(threads):
            item = waiting.get()
            if isinstance(item, PanopticError):
                raise item
            ended += isinstance(item, EndOfStream)
            yield item
    finally:
        over.set()


def _numbered(order: int, stream: Iterator[Any]) -> Iterator[tuple[int, int, Any]]:
    last = -1
    for item in stream:
        last = item.stamp_ns if hasattr(item, "stamp_ns") else last + 1
        yield last, order, item


def _streams(plan: Plan) -> Iterator[Iterator[Any]]:
    for name in plan.rig.names:
        if plan.bag is None:
            yield _frames(plan, name)
        else:
            topic = next((t for t, camera in plan.bag_topics.items() if camera == name), None)
            yield _recorded(plan, plan.bag, topic, name)


def _frames(plan: Plan, camera: str) -> Iterator[Any]:
    source = plan.sources[camera]
    options = {k: v for k, v in source.items() if k not in ("kind", "path", "device")}
    if source["kind"] == "device":
        with open_live(camera, plan.rig, source["device"], options) as device:
            yield from device
    elif source["kind"] == "folder":
        with open_capture_folder(Path(source["path"]), rig=plan.rig, cameras=[camera], **options) as capture:
            yield from capture.sources[0]
    else:
        path = Path(source["path"])
        with open_files(plan.rig.subset([camera]), {camera: path}, **options) as capture:
            yield from capture.sources[0]
    yield EndOfStream(camera)


def _recorded(plan: Plan, bag: Path, topic: str | None, camera: str) -> Iterator[Any]:
    with BagReader(bag) as reader:
        for number, (_, _, message) in enumerate(reader.messages(topic) if topic else ()):
            if plan.stage == "sync":
                yield from_message(message, "ViewDetections")
            else:
                yield frame_from_message(message, camera, number)
    yield EndOfStream(camera)
