"""A recorded bag as the world of a bench: real 2D people and real score maps."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from panoptic_ros.bench.stage1.world import World
from panoptic_ros.domain import DetectionSet, EndOfStream, Rig
from panoptic_ros.errors import DataError
from panoptic_ros.graph.build import configure, make_stage
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.bags import BagReader
from panoptic_ros.io.compared_skeletons import read_sequence
from panoptic_ros.io.messages import from_message
from panoptic_ros.stage import StageContext
from panoptic_ros.voting.volume import volume_of_rig

WINDOW_S = 0.01  # views that are so near in time are of one instant
VOXEL = 0.04  # m


def recorded_world(
    bag: str, cameras: list[str] | None, truth: str | None, frames: int, bounds: list[float] | None
) -> World:
    """The first detection sets of a bag that `panoptic run` wrote.

    `bounds` (m) are those of `World`; None = what two cameras see.

    Raises:
        DataError: if it has no rig, skeleton or detections, or is damaged.
        CalibrationError: if it has no camera of a name.
    """
    with BagReader(Path(bag)) as reader:
        rig, skeleton = _latched(reader, "rig"), _latched(reader, "skeleton_model")
    if cameras:
        rig = rig.subset(cameras)
    config = configure({"sync": {"window_s": WINDOW_S}})["sync"]
    stage = make_stage("sync", config, StageContext(rig, skeleton))
    sets: list[DetectionSet] = []
    for item in _detections(Path(bag), rig):
        sets += stage.step(item).outputs
        if len(sets) >= frames:
            break
    else:
        sets += stage.flush().outputs
    if not sets:
        raise DataError(f"{bag} has no detections of the cameras {', '.join(rig.names)}")
    if bounds is None:
        volume = volume_of_rig(rig, VOXEL)
        bounds = [VOXEL * float(edge) for edge in (*volume.lower, *volume.upper)]
    known = read_sequence(Path(truth)) if truth else None
    return World(rig, skeleton, tuple(sets[:frames]), tuple(bounds), known)


def _latched(reader: BagReader, key: str) -> Any:
    topic = "/" + TOPICS[key].name
    for _, _, message in reader.messages(topic) if topic in reader.topics else ():
        return from_message(message, TOPICS[key].record)
    raise DataError(f"{reader.path} has no message on {topic}; write the bag with `panoptic run`")


def _detections(bag: Path, rig: Rig) -> Iterator[Any]:
    """The views of all cameras by stamp, and the end of each."""

    def stream(order: int, camera: str) -> Iterator[tuple[int, int, Any]]:
        last = 0
        with BagReader(bag) as reader:
            topic = "/" + TOPICS["detections"].of(camera)
            for _, _, message in reader.messages(topic) if topic in reader.topics else ():
                view = from_message(message, "ViewDetections")
                last = view.stamp_ns
                yield last, order, view
        yield last + 1, order, EndOfStream(camera)

    streams = [stream(order, camera) for order, camera in enumerate(rig.names)]
    for _, _, item in heapq.merge(*streams, key=lambda row: row[:2]):
        yield item
