"""Detection under several settings on one capture: processor time, and the accuracy of what comes of it."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.bench.detection_costs import TABLE, Costs
from panoptic_ros.bench.stage1.rows import of_poses
from panoptic_ros.capture import open_capture_folder
from panoptic_ros.detection.config import DetectionConfig
from panoptic_ros.detection.one_thread import one_thread
from panoptic_ros.domain import ViewFrame
from panoptic_ros.evaluation import SkeletonSequence, pair_sequences
from panoptic_ros.evaluation.newcomers import newcomers_scores
from panoptic_ros.evaluation.report import report_of
from panoptic_ros.graph.build import configure, merged
from panoptic_ros.graph.pipeline import Pipeline
from panoptic_ros.io.compared_skeletons import spelt_alike
from panoptic_ros.io.detector_context import detector_extras
from panoptic_ros.params import config_of
from panoptic_ros.stage import StageContext

Settings = Mapping[str, Mapping[str, Any]]
SKELETON = "panoptic19"
FULL = "every image"  # what the others are compared with
HALF_A_FRAME_NS = 10_000_000


@dataclass(frozen=True)
class Footage:
    """A capture folder, of which some cameras and frames are used.

    Args:
        cameras: names; None = all. frames: of each camera at most. every: only each so manyth frame.
        apart: every other camera has the frames in the middle between those of the others, as without a
            common trigger.
    """

    folder: Path
    cameras: tuple[str, ...] | None = None
    frames: int | None = None
    every: int = 1
    apart: bool = False

    def images(self) -> Iterator[ViewFrame]:
        """All images, instant by instant."""
        with closing(open_capture_folder(self.folder, cameras=self.cameras)) as capture:
            streams = [iter(source) for source in capture.sources]
            for index, instant in enumerate(zip(*streams)):
                if self.frames is not None and index >= self.frames:
                    return
                for place, frame in enumerate(instant):
                    later = self.every // 2 if self.apart and place % 2 else 0
                    if index % self.every == later:
                        yield frame


def variants(rate_hz: float) -> dict[str, dict[str, Any]]:
    """Parameters of detection by the name of the setting, for cameras of so many frames per second."""
    found: dict[str, dict[str, Any]] = {FULL: {}, "regions, every image": {"regions": "on"}}
    for period in (2, 3, 4):
        looks = rate_hz / period
        found[f"every {period}. image, whole"] = {"looks_per_s": looks, "regions": "off"}
        found[f"every {period}. image"] = {"looks_per_s": looks}
    found["every 4. image, 160 px"] = {"looks_per_s": rate_hz / 4, "region_height": 160}
    return found


def measured(
    footage: Footage, truth: SkeletonSequence, own: Mapping[str, Any], settings: Settings, skip: int
) -> dict[str, Any]:
    """One setting: a run of all stages on the images. Processor time is that of this thread, on which a
    network of one thread runs too: others decode the images that come.

    Args:
        own: parameters of detection. settings: of all stages, under these. skip: first frames of the truth
            that are not scored, nor their time.
    """
    values = merged(settings, {"detection": own})
    configs = configure(values)
    with closing(open_capture_folder(footage.folder, cameras=footage.cameras)) as capture:
        rig = capture.rig
    skeleton, extras = detector_extras(config_of(configs, DetectionConfig).model, SKELETON)
    taken: Counter[str] = Counter()
    poses: list[Any] = []
    carried = images = 0
    costs = Costs()

    def saw(topic: str, record: Any) -> None:
        nonlocal carried
        if topic == "skeletons":
            poses.append(record)
        elif topic == "detections" and record.carried is not None:
            carried += 1

    def stepped(stage: str, duration_ns: int) -> None:
        if images >= skip * len(rig):  # the first instants have nobody who is known
            taken[stage] += duration_ns

    pipeline = Pipeline(
        configs,
        StageContext(rig, skeleton, {**extras, "costs": costs}),
        on_record=saw,
        on_step=stepped,
        clock=time.thread_time_ns,
        table=TABLE,
    )
    stamps = []  # of the first camera
    with one_thread():
        for frame in footage.images():
            costs.counting = images >= skip * len(rig)
            pipeline.push("image", frame)
            images += 1
            if frame.camera == rig.names[0]:
                stamps.append(frame.stamp_ns)
        pipeline.flush()
    instants = images // len(rig)
    counted = max(instants - skip, 1)
    return {
        "cpu_ms": 1e-6 * taken["detection"] / counted,
        "after_ms": 1e-6 * (sum(taken.values()) - taken["detection"]) / counted,
        "beside_ms": costs.beside_ms,
        "carry_ms": costs.carry_ms,
        "carried": carried / max(images, 1),
        "instants": instants,
        **_scores(truth, SkeletonSequence(skeleton.joint_names, tuple(map(of_poses, poses))), stamps, skip),
    }


def _scores(
    truth: SkeletonSequence, result: SkeletonSequence, stamps: Sequence[int], skip: int
) -> dict[str, Any]:
    """Scores by the names of `panoptic evaluate --json`, at the instants of images with these stamps."""
    instants = np.array([frame.stamp_ns for frame in truth.frames])
    near = np.abs(instants[:, None] - np.array(stamps)).min(axis=1)
    frames = tuple(frame for frame, away in zip(truth.frames, near) if away < HALF_A_FRAME_NS)
    within = SkeletonSequence(truth.joint_names, frames)
    pairs = pair_sequences(within, spelt_alike(result, within), skip)
    return {**report_of(pairs, within.joint_names).to_mapping(), **newcomers_scores(pairs)}
