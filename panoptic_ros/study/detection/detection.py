"""The study `detection`: time and accuracy of network runs at a lower rate, regions and propagation.

The reference setting runs the network on every image.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.capture import open_capture_folder
from panoptic_ros.detection.config import DetectionConfig
from panoptic_ros.detection.one_thread import one_thread
from panoptic_ros.domain import ViewFrame
from panoptic_ros.errors import UsageError
from panoptic_ros.evaluation import SkeletonSequence, pair_sequences
from panoptic_ros.evaluation.newcomers import newcomers_scores
from panoptic_ros.evaluation.report import report_of
from panoptic_ros.graph.build import config_class, configure, merged, parse_setting
from panoptic_ros.graph.pipeline import Pipeline
from panoptic_ros.io.compared_skeletons import only_joints, read_sequence, spelt_alike
from panoptic_ros.io.detector_context import detector_extras
from panoptic_ros.params import config_of, load
from panoptic_ros.running.arguments import within
from panoptic_ros.running.plans.parameters import read_parameters
from panoptic_ros.stage import Progress, StageContext
from panoptic_ros.study.detection.costs import TABLE, Costs
from panoptic_ros.study.options import add_capture, add_settings
from panoptic_ros.study.stage1.rows import of_poses
from panoptic_ros.study.study import Case, Column, Result, Row, Study

Settings = Mapping[str, Mapping[str, Any]]
SKELETON = "panoptic19"
FULL = "every image"  # reference of the comparison
HALF_A_FRAME_NS = 10_000_000  # limit of the time from a true frame to the nearest image


class Detection(Study):
    """Every setting on the same images of one capture."""

    columns = (
        Column("setting", ""),
        Column("cpu_ms", "ms", ".1f"),
        Column("gain", "1 /", ".2f"),
        Column("beside_ms", "beside net", ".2f"),
        Column("carry_ms", "carrying", ".2f"),
        Column("after_ms", "after", ".1f"),
        Column("median_mm", "median mm", ".1f"),
        Column("pck_5", "PCK 5 cm", ".3f"),
        Column("pck_10", "10 cm", ".3f"),
        Column("found_persons", "found"),
        Column("truth_persons", "of"),
        Column("result_persons", "reported"),
        Column("id_switches", "switches"),
        Column("newcomers", "come"),
        Column("newcomers_missed", "missed"),
        Column("newcomers_wait_s", "after s", ".2f"),
    )
    has_plot = True

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        count = within(int, 1, 10**6)
        add_capture(parser, "capture folder")
        parser.add_argument(
            "--truth",
            type=Path,
            metavar="FILE",
            help="true skeletons of the capture; default: truth.json.gz in its folder",
        )
        parser.add_argument(
            "--frames", type=count, metavar="N", help="use only the first N frames of each camera"
        )
        parser.add_argument("--every", type=count, default=1, metavar="N", help="use only every N-th frame")
        parser.add_argument("--apart", action="store_true", help="shift every second camera by half a period")
        parser.add_argument(
            "--rate", type=within(float, 0.1, 1e4), default=25.0, metavar="HZ", help="frame rate; default 25"
        )
        parser.add_argument(
            "--joints", default="coco17", metavar="NAMES", help="joints to score; default coco17"
        )
        parser.add_argument(
            "--skip",
            type=int,
            default=6,
            metavar="N",
            help="number of first frames to leave out of the scores; default 6",
        )
        parser.add_argument(
            "--only",
            action="append",
            metavar="TEXT",
            help=f'only settings whose names contain this text, and "{FULL}"; repeatable',
        )
        parser.add_argument(
            "--detection",
            action="append",
            metavar="A=1,B=2",
            help="one more setting: parameters of detection",
        )
        add_settings(parser)

    def cases(self) -> list[Case]:
        """See `Study`."""
        given = self.options
        if given.apart and given.every < 2:
            raise UsageError("--apart needs --every 2 or more: cameras have frames that others leave out")
        return [Case(name, own) for name, own in self.chosen().items()]

    def chosen(self) -> dict[str, dict[str, Any]]:
        """Return the detection parameters by name of the setting; the reference comes first."""
        given = self.options
        everything = variants(given.rate / given.every)
        wanted = {
            name: own
            for name, own in everything.items()
            if name == FULL or given.only is None or any(text in name for text in given.only)
        }
        if given.only is not None and len(wanted) == 1 and not given.detection and given.only != [FULL]:
            raise UsageError(f"no setting contains {given.only[0]!r}; there are {', '.join(everything)}")
        for text in given.detection or ():
            parts = [parse_setting(f"detection.{part}") for part in text.split(",")]
            wanted[text] = {name: value for _, name, value in parts}
        for own in wanted.values():
            load(config_class("detection"), own, where="detection.")
            if own.get("threads", 1) != 1:
                raise UsageError(
                    f"detection.threads = {own['threads']}: processor time is that of one thread; leave it 1"
                )
        return wanted

    def measure(self, case: Case, progress: Progress) -> list[Row]:
        """See `Study`."""
        given = self.options
        cameras = tuple(given.cameras) or None
        footage = Footage(given.capture, cameras, given.frames, given.every, given.apart)
        truth = only_joints(read_sequence(given.truth or given.capture / "truth.json.gz"), given.joints)
        settings = read_parameters(None, given.settings)
        row = measured(footage, truth, case.request, settings, given.skip)
        pck = row["pck_of_everybody"]
        about = {"setting": case.title, "parameters": case.request}
        return [about | row | {"pck_5": pck.get("0.05"), "pck_10": pck.get("0.10")}]

    def summary(self, rows: list[Row]) -> Mapping[str, Any]:
        """Add the gain of each row relative to the first row; see `Study`."""
        for row in rows:
            row["gain"] = rows[0]["cpu_ms"] / row["cpu_ms"]
        return {"capture": str(self.options.capture), "cameras": self.options.cameras}

    def head(self, result: Result) -> str:
        """See `Study`."""
        return (
            f"{result['capture']}: {result['rows'][0]['instants']} instants; ms of processor time of "
            "detection per instant; of a look beside the network; of a view that is carried"
        )

    def plot(self, path: Path, result: Result) -> None:
        """See `Study`."""
        # imported here because matplotlib is slow to load
        from panoptic_ros.view.detection_plot import write_plot

        rows = result["rows"]
        write_plot(path, rows, f"{result['capture']}, {rows[0]['instants']} instants")


@dataclass(frozen=True)
class Footage:
    """Selected cameras and frames of a capture folder.

    Args:
        cameras: names; None = all.
        frames: limit of frames per camera.
        every: use every N-th frame only.
        apart: shift every second camera by half a period, as without a common trigger.
    """

    folder: Path
    cameras: tuple[str, ...] | None = None
    frames: int | None = None
    every: int = 1
    apart: bool = False

    def images(self) -> Iterator[ViewFrame]:
        """Yield all images in the order of their frames."""
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
    """Return the detection parameters by name of the setting, for cameras with this frame rate."""
    found: dict[str, dict[str, Any]] = {FULL: {}, "regions, every image": {"regions": "on"}}
    for period in (2, 3, 4):
        looks = rate_hz / period
        found[f"every {period}. image, whole"] = {"looks_per_s": looks, "regions": "off"}
        found[f"every {period}. image"] = {"looks_per_s": looks}
    found["every 4. image, 160 px"] = {"looks_per_s": rate_hz / 4, "region_height": 160}
    return found


def measured(
    footage: Footage, truth: SkeletonSequence, own: Mapping[str, Any], settings: Settings, skip: int
) -> Row:
    """Run all stages on the images with one setting, and return its time and scores.

    The processor time is that of this thread. A network of one thread runs on it too. Other threads decode
    the images.

    Args:
        own: parameters of detection.
        settings: parameters of all stages; `own` overrides them.
        skip: first frames of the truth without score; their time does not count either.
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
        if images >= skip * len(rig):  # the first time steps have no tracks yet
            taken[stage] += duration_ns

    pipeline = Pipeline(
        configs,
        StageContext(rig, skeleton, {**extras, "costs": costs}),
        on_record=saw,
        on_step=stepped,
        clock=time.thread_time_ns,
        table=TABLE,
    )
    stamps = []  # timestamps (ns) of the first camera
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
    """Score the result with the names of `panoptic evaluate --json`, at the timestamps of the images."""
    instants = np.array([frame.stamp_ns for frame in truth.frames])
    near = np.abs(instants[:, None] - np.array(stamps)).min(axis=1)
    frames = tuple(frame for frame, away in zip(truth.frames, near) if away < HALF_A_FRAME_NS)
    within = SkeletonSequence(truth.joint_names, frames)
    pairs = pair_sequences(within, spelt_alike(result, within), skip)
    return {**report_of(pairs, within.joint_names).to_mapping(), **newcomers_scores(pairs)}
