"""Runs a plan in one process without ROS. The stages and the results are as in the node graph.

Live cameras: the run takes the newest frames of all cameras instant by instant, and all sound.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from itertools import takewhile
from typing import Any, Protocol

from panoptic_ros.capture import open_recording, open_source
from panoptic_ros.capture.imus import imu_samples
from panoptic_ros.capture.sound import open_sound
from panoptic_ros.detection.config import DetectionConfig
from panoptic_ros.domain import AudioBlock
from panoptic_ros.errors import DataError, PanopticError
from panoptic_ros.graph.build import make_stage, ports_in_use, switched_on
from panoptic_ros.graph.counters import StageStatistics
from panoptic_ros.graph.host import Host, Key, lanes_of
from panoptic_ros.graph.nodes import NODES
from panoptic_ros.graph.offline_refinement import refinement_of
from panoptic_ros.graph.pipeline import Pipeline
from panoptic_ros.graph.queues import NewestInstantQueue
from panoptic_ros.graph.side_by_side import TABLE, ParallelDetection, looked_ahead
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.bag_streams import IMU_KEY, SOUND_KEY, TRACKS_KEY, opened_streams
from panoptic_ros.params import config_of
from panoptic_ros.running.plans.free_threads import free_threads
from panoptic_ros.running.plans.plan import Plan
from panoptic_ros.running.runs.finish import TOLD
from panoptic_ros.running.runs.results import Results
from panoptic_ros.stage import Notice, StageContext


def newest_frames(
    cameras: Iterable[str],
    frames: Callable[[str], Iterator[Any]],
    stop: Callable[[], bool],
    on_drop: Callable[[int], None],
    sounds: Sequence[Callable[[], Iterator[Any]]] = (),
) -> Iterator[Any]:
    """Yield the frames of live cameras, dropping the same frames as a detection node that falls behind.

    Args:
        frames: Returns the frames of a camera; called in one thread per camera.
        stop: Stop condition, polled often, also while no frame arrives.
        on_drop: Callback with the number of dropped frames.
        sounds: Each returns the audio blocks of a device, and runs in its own thread. No block is dropped.
            The end of one device does not end the other devices.

    Raises:
        PanopticError: the error that ended a camera or a sound.
    """
    names = list(cameras)
    waiting, changed, over = NewestInstantQueue(names), threading.Condition(), threading.Event()
    faults: list[PanopticError] = []
    dropped: list[int] = []
    ended: list[str] = []
    heard: list[Any] = []

    def read(camera: str) -> None:
        try:
            for item in frames(camera):
                if over.is_set():
                    return
                with changed:
                    dropped.append(waiting.put(camera, item.stamp_ns, item))
                    changed.notify()
        except PanopticError as error:
            faults.append(error)
        finally:
            ended.append(camera)

    def listen(sound: Callable[[], Iterator[Any]]) -> None:
        try:
            for block in sound():
                if over.is_set():
                    return
                with changed:
                    heard.append(block)
                    changed.notify()
        except PanopticError as error:
            faults.append(error)

    for name in names:
        threading.Thread(target=read, args=(name,), daemon=True).start()
    for sound in sounds:
        threading.Thread(target=listen, args=(sound,), daemon=True).start()
    try:
        while not stop():
            with changed:
                all_ended = len(ended) == len(names)  # read before the last frames are taken from the queue
                batch = waiting.take()
                if not batch and not heard:
                    changed.wait(0.2)
                blocks = heard[:]
                heard.clear()
                lost = sum(dropped)
                dropped.clear()
            if lost:
                on_drop(lost)
            if faults:
                raise faults[0]
            yield from blocks
            if not batch and not blocks and all_ended:
                return
            yield from batch
    finally:
        over.set()


# input topics that the results keep
TAKEN = ("image", "detections", SOUND_KEY, IMU_KEY, "sensor_depth", TRACKS_KEY)

REFINED = ("patch_tracks", "sensor_depth", "skeletons_raw")  # input topics of offline refinement


class RecordReceiver(Protocol):
    """Receiver of the records of a run."""

    def take(self, key: str, record: Any) -> None:
        """Receive a record of the topic with that key."""


Records = dict[Key, Iterator[Any]]  # records by (topic, camera)


class OfflineResults:
    """Receiver of the records of a run in one process. Offline refinement replaces the fixed-lag smoother."""

    def __init__(self, plan: Plan, results: Results):
        self._results = results
        self._refinement = refinement_of(plan.configs, StageContext(plan.rig, plan.skeleton, plan.extras))

    def take(self, key: str, record: Any) -> None:
        """Pass a record to the results, and to offline refinement if it needs the topic."""
        if key != "skeletons":
            self._results.take(key, record)
        if key in REFINED:
            for output in self._refinement.take(record):
                self._results.take("skeletons", output)

    def flush(self) -> None:
        """Pass the remaining skeletons of offline refinement to the results."""
        for output in self._refinement.flush():
            self._results.take("skeletons", output)


class _CountedPipeline:
    """Pipeline of a run, with statistics of its stages."""

    def __init__(self, plan: Plan, results: RecordReceiver, looks: ParallelDetection | None = None):
        names = switched_on(plan.stages, plan.configs)
        self.statistics = {name: StageStatistics() for name in names}
        self._giver = {topic: name for name in names for topic in NODES[name].outputs}
        self._results = results
        self.pipeline = Pipeline(
            plan.configs,
            StageContext(plan.rig, plan.skeleton, {**plan.extras, "looks": looks}),
            names,
            on_record=self._record,
            on_notice=self._note,
            on_refused=self._refuse,
            on_step=self._step,
            clock=time.perf_counter_ns,
            table=NODES if looks is None else TABLE,
        )
        self._looks = looks
        # sequence number of each place (bag and topic) with refused records
        self._places: dict[str, int] = {}
        self.first = plan.stage

    def _note(self, stage: str, notice: Notice) -> None:
        self.statistics[stage].take(notice)
        if notice.severity == "warning" and notice.code.startswith(TOLD):
            self._tell()

    def _record(self, key: str, item: Any) -> None:
        self.statistics[self._giver[key]].given += 1
        self._results.take(key, item)

    def _refuse(self, stage: str, error: DataError) -> None:
        self.statistics[stage].dropped["bad_message"] += 1

    def _step(self, stage: str, duration_ns: int) -> None:
        if stage == "detection" and self._looks is not None:
            duration_ns = self._looks.duration_ns
        self.statistics[stage].taken += 1
        self.statistics[stage].add_duration(duration_ns)

    def refuse(self, error: DataError) -> None:
        """Count an unusable input record, and warn with its bag and topic."""
        self._refuse(self.first, error)
        place = str(error).partition(": ")[0]  # the bag and the topic
        number = self._places.setdefault(place, len(self._places))
        self._note(self.first, Notice(f"source.bad_message.{number}", "warning", str(error)))

    def note(self, notice: Notice) -> None:
        """Record a notice about the input."""
        self._note(self.first, notice)

    def drop(self, count: int) -> None:
        """Count live frames that newer ones replaced."""
        self.statistics[self.first].dropped["overtaken"] += count
        self._tell()

    def _tell(self) -> None:
        self._results.take("diagnostics", {name: stage.values() for name, stage in self.statistics.items()})


def run_in_process(
    plan: Plan, results: RecordReceiver, stop: Callable[[], bool]
) -> dict[str, StageStatistics]:
    """Run the plan until its end or until `stop()` is true; return the statistics of each stage."""
    if plan.live:
        counted = _CountedPipeline(plan, results)
        frames, sounds = partial(_live_frames, plan), [partial(_live_sound, s) for s in plan.sounds]
        for item in newest_frames(plan.rig.names, frames, stop, counted.drop, sounds):
            topic = SOUND_KEY if isinstance(item, AudioBlock) else "image"
            if topic in TAKEN:
                results.take(topic, item)
            counted.pipeline.push(topic, item)
        counted.pipeline.flush()
        return counted.statistics
    with ExitStack() as stack:
        refused: list[DataError] = []
        known: list[Notice] = []  # notices that arrive after the last frames
        records: Records = (
            _recorded(plan, stack, refused.append)
            if plan.streams
            else open_recording(plan.rig, {n: plan.sources[n] for n in plan.rig.names}, stack, known.append)
        )
        looks = _side_by_side(plan, stack, records)
        counted = _CountedPipeline(plan, results, looks)
        for sound in plan.sounds:
            source = stack.enter_context(open_sound(sound))
            records[SOUND_KEY, source.device] = iter(source)
        for sensor in plan.maps:
            records["sensor_depth", sensor.camera] = takewhile(partial(_is_before, plan), sensor)
        for device, path in plan.imus.items():
            records[IMU_KEY, device] = imu_samples(path, [device], plan.until_ns)
        _replay(plan, counted.pipeline, records, results, stop)
        for error in refused:
            counted.refuse(error)
        for notice in known:
            counted.note(notice)
    return counted.statistics


def _is_before(plan: Plan, record: Any) -> bool:
    """Return whether a record lies before the end of the plan."""
    return plan.until_ns is None or bool(record.stamp_ns < plan.until_ns)


def _side_by_side(plan: Plan, stack: ExitStack, records: Records) -> ParallelDetection | None:
    """Let detection run ahead in several threads where that is faster and safe.

    The images in `records` are replaced by images with finished detections. The result is None if detection
    must run in the pipeline. This is so if tracking guides detection, or if bags hold depth maps, whose
    timestamps may jump.
    """
    config = plan.configs["detection"]
    threads = free_threads(config_of(plan.configs, DetectionConfig).threads)
    in_bags = plan.streams and plan.depth_cameras
    tied = plan.stage != "detection" or not plan.rig.cameras or in_bags or ports_in_use({"detection": config})
    if threads == 1 or tied:
        return None
    stage = make_stage("detection", config, StageContext(plan.rig, plan.skeleton, plan.extras))
    return stack.enter_context(looked_ahead(records, stage, threads, time.perf_counter_ns))


def _replay(
    plan: Plan, pipeline: Pipeline, records: Records, results: RecordReceiver, stop: Callable[[], bool]
) -> None:
    """Push the records of all sources into the pipeline.

    Each step takes the next record of the source that the stages wait for.
    """
    owners = {topic: [camera for key, camera in records if key == topic] for topic, _ in records}
    lanes = lanes_of(list(owners), lambda topic: owners[topic], pipeline, plan.clock_of, plan.shifts)
    host = Host(pipeline, lanes)
    while (key := host.waiting_for()) is not None:
        if stop():
            pipeline.flush()
            return
        topic, owner = key
        record = next(records[key], None)
        if record is None:
            host.end(topic, owner)
        else:
            if topic in TAKEN:
                results.take(topic, record)
            host.put(topic, owner, record.stamp_ns, record)
        host.advance()


def _live_frames(plan: Plan, camera: str) -> Iterator[Any]:
    source, _ = open_source(camera, plan.rig, plan.sources[camera])
    with source:
        yield from source


def _live_sound(sound: Mapping[str, Any]) -> Iterator[Any]:
    with open_sound(sound) as source:
        yield from source


def _recorded(plan: Plan, stack: ExitStack, on_bad: Callable[[DataError], None]) -> Records:
    """Return the frames, depth maps or detections of bags by (topic, camera).

    Unusable records are left out.
    """
    return {
        (TOPICS[stream.key].variant_of or stream.key, stream.camera): iter(items)
        for stream, items in opened_streams(plan.streams, stack, on_bad)
    }
