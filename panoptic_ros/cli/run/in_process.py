"""A run in one process, without ROS: the same stages, the same results."""
from __future__ import annotations

import heapq
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from panoptic_ros.capture import open_source
from panoptic_ros.cli.run.newest_frames import newest_frames
from panoptic_ros.cli.run.plan import Plan
from panoptic_ros.cli.run.results import Results
from panoptic_ros.domain import EndOfStream
from panoptic_ros.graph.counters import StageStatistics
from panoptic_ros.graph.depth_pairing import DepthPairing, Pair
from panoptic_ros.graph.nodes import NODES
from panoptic_ros.graph.pipeline import CHAIN, Pipeline
from panoptic_ros.io.bags import BagReader
from panoptic_ros.io.messages import frame_from_message, from_message, stamp_of
from panoptic_ros.stage import Notice, StageContext


def run_in_process(plan: Plan, results: Results, stop: Any) -> dict[str, StageStatistics]:
    """Run the plan to its end, or until `stop()` is true; returns what each stage counted."""
    stages = CHAIN[CHAIN.index(plan.stage) :]
    beside = ("offsets",) if plan.configs["offsets"].active else ()  # type: ignore[attr-defined]
    statistics = {name: StageStatistics() for name in (*stages, *beside)}

    def note(stage: str, notice: Notice) -> None:
        statistics[stage].notices[notice.code] += 1

    def record(key: str, item: Any) -> None:
        name = next(name for name in statistics if NODES[name].gives == key)
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

    def drop(count: int) -> None:
        statistics[plan.stage].dropped["overtaken"] += count
        results.take("diagnostics", {name: stage.values() for name, stage in statistics.items()})

    live = newest_frames(plan.rig.names, partial(_frames, plan), stop, drop) if plan.live else None
    for item in live or _items(plan):
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
    """Frames or detections of all cameras of a recording by stamp, and the end of each."""
    streams = [_numbered(order, stream) for order, stream in enumerate(_streams(plan))]
    for _, _, item in heapq.merge(*streams, key=lambda row: row[:2]):
        yield item


def _numbered(order: int, stream: Iterator[Any]) -> Iterator[tuple[int, int, Any]]:
    last = -1
    for item in stream:
        last = item.stamp_ns if hasattr(item, "stamp_ns") else last + 1
        yield last, order, item


def _streams(plan: Plan) -> list[Iterator[Any]]:
    if plan.bag is not None:
        topics = sorted(plan.bag_topics, key=lambda topic: plan.rig.index(plan.bag_topics[topic]))
        return [_recorded(plan, plan.bag, topic) for topic in topics]
    return [_frames(plan, name) for name in plan.rig.names]


def _frames(plan: Plan, camera: str) -> Iterator[Any]:
    source, _ = open_source(camera, plan.rig, plan.sources[camera])
    with source:
        yield from source
    if not plan.live:
        yield EndOfStream(camera)


def _recorded(plan: Plan, bag: Path, topic: str) -> Iterator[Any]:
    camera = plan.bag_topics[topic]
    with BagReader(bag) as reader:
        if plan.stage == "sync":
            for _, _, message in reader.messages(topic):
                yield from_message(message, "ViewDetections")
        else:
            for number, pair in enumerate(_pairs(plan, reader, topic)):
                yield frame_from_message(pair.image, camera, number, pair.depth)
    yield EndOfStream(camera)


def _pairs(plan: Plan, reader: BagReader, topic: str) -> Iterator[Pair]:
    """The images of a topic with their depth maps, as the detection node puts them together."""
    camera = plan.bag_topics[topic]
    depths = [name for name, owner in plan.depth_topics.items() if owner == camera]
    pairing = DepthPairing(plan.depth_cameras, None)
    for name, _, message in reader.messages(topic, *depths):
        take = pairing.image if name == topic else pairing.depth
        yield from take(camera, stamp_of(message.header), message)
    yield from pairing.end(camera)
