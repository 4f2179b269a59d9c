"""A run in one process, without ROS: the same stages, the same results."""
from __future__ import annotations

import heapq
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from panoptic_ros.capture import open_source
from panoptic_ros.domain import EndOfStream
from panoptic_ros.errors import DataError
from panoptic_ros.graph.counters import StageStatistics
from panoptic_ros.graph.depth_pairing import DepthPairing, Pair
from panoptic_ros.graph.nodes import NODES
from panoptic_ros.graph.pipeline import CHAIN, Pipeline
from panoptic_ros.io.bag_streams import DEPTH_KEYS, merged
from panoptic_ros.io.messages import frame_from_message, from_message
from panoptic_ros.offsets.config import OffsetsConfig
from panoptic_ros.params import config_of
from panoptic_ros.running.newest_frames import newest_frames
from panoptic_ros.running.plan import Plan
from panoptic_ros.running.results import Results
from panoptic_ros.stage import Notice, StageContext


def run_in_process(plan: Plan, results: Results, stop: Any) -> dict[str, StageStatistics]:
    """Run the plan to its end, or until `stop()` is true; returns what each stage counted."""
    stages = CHAIN[CHAIN.index(plan.stage) :]
    beside = ("offsets",) if config_of(plan.configs, OffsetsConfig).active else ()
    statistics = {name: StageStatistics() for name in (*stages, *beside)}

    def note(stage: str, notice: Notice) -> None:
        statistics[stage].take(notice)

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

    def refuse(error: DataError) -> None:
        statistics[plan.stage].dropped["bad_message"] += 1

    if plan.live:
        items: Iterator[Any] = newest_frames(plan.rig.names, partial(_frames, plan), stop, drop)
    else:
        items = _recorded(plan, refuse) if plan.streams else _filmed(plan)
    for item in items:
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


def _filmed(plan: Plan) -> Iterator[Any]:
    """Frames of all cameras of a recording by stamp, and the end of each."""
    streams = [_numbered(order, _frames(plan, name)) for order, name in enumerate(plan.rig.names)]
    for _, _, item in heapq.merge(*streams, key=lambda row: row[:2]):
        yield item


def _numbered(order: int, stream: Iterator[Any]) -> Iterator[tuple[int, int, Any]]:
    last = -1
    for item in stream:
        last = item.stamp_ns if hasattr(item, "stamp_ns") else last + 1
        yield last, order, item


def _frames(plan: Plan, camera: str) -> Iterator[Any]:
    source, _ = open_source(camera, plan.rig, plan.sources[camera])
    with source:
        yield from source
    if not plan.live:
        yield EndOfStream(camera)


def _recorded(plan: Plan, on_bad: Callable[[DataError], None]) -> Iterator[Any]:
    """Frames or detections of bags, and the end of all cameras; what cannot be used is left out."""
    numbers = dict.fromkeys(plan.rig.names, 0)
    for pair in _pairs(plan, on_bad):
        try:
            if plan.stage == "sync":
                yield from_message(pair.image, "ViewDetections")
            else:
                yield frame_from_message(pair.image, pair.camera, numbers[pair.camera], pair.depth)
        except DataError as error:
            on_bad(error)
        numbers[pair.camera] += 1
    yield from map(EndOfStream, plan.rig.names)


def _pairs(plan: Plan, on_bad: Callable[[DataError], None]) -> Iterator[Pair]:
    """Messages of all cameras; images with their depth maps, as the detection node puts them together."""
    pairing = DepthPairing(plan.depth_cameras, None)
    for item in merged(plan.streams, on_bad):
        take = pairing.depth if item.stream.key in DEPTH_KEYS else pairing.image
        yield from take(item.stream.camera, item.stamp_ns, item.message)
    for camera in plan.depth_cameras:
        yield from pairing.end(camera)
