"""What a run leaves in its folder: all of it, or nothing."""
from __future__ import annotations

import os
import shutil
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from panoptic_ros.domain import ClockModel, RefinedPoseSet, ViewDetections
from panoptic_ros.errors import UsageError
from panoptic_ros.evaluation.body_tally import BodyTally
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.bag_streams import IMU_KEY, SOUND_KEY
from panoptic_ros.io.bags import BagWriter
from panoptic_ros.io.body_stream import BodyStream
from panoptic_ros.io.clock_offsets import write_models
from panoptic_ros.io.files import file_errors
from panoptic_ros.io.folders import MARK
from panoptic_ros.io.messages import bag_messages, to_message
from panoptic_ros.io.messages.markers import marker_array
from panoptic_ros.io.previews import Previews
from panoptic_ros.io.skeleton_stream import SkeletonStream
from panoptic_ros.params import config_of, named_numbers, of_name
from panoptic_ros.patches.config import PatchesConfig
from panoptic_ros.running.plans.plan import Plan
from panoptic_ros.sync.config import SyncConfig
from panoptic_ros.view.body_drawing import DrawnBody, drawn_bodies

PATCHES = ("patch_tracks", "skeletons_raw", "patches")  # what refinement takes, where patches are on
KEPT_LIVE = 3600  # instants that the report of a live run, which has no end, is about: two minutes


@contextmanager
def result_folder(out: Path) -> Iterator[Path]:
    """A temporary folder beside `out` that takes its place at the end, or vanishes on an error.

    Raises:
        UsageError: if `out` is a file, or a folder with other things in it.
        EnvironmentProblem: if it cannot be written.
    """
    out = Path(out)
    if out.exists() and not out.is_dir():
        raise UsageError(f"--out {out} is a file; give a folder")
    if out.is_dir() and any(out.iterdir()) and not (out / MARK).is_file():
        raise UsageError(f"--out {out} holds other things than the results of a run; choose another folder")
    part = out.with_name(f".{out.name}.{os.getpid()}.part")
    old = out.with_name(f".{out.name}.{os.getpid()}.old")
    with file_errors(out, "write"):
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir(parents=True)
    try:
        yield part
        with file_errors(out, "write"):
            if out.exists():
                os.replace(out, old)
            os.replace(part, out)
    finally:
        shutil.rmtree(part, ignore_errors=True)
        shutil.rmtree(old, ignore_errors=True)


def patch_topics(plan: Plan) -> list[tuple[str, str]]:
    """Keys and owners of what a run keeps of patches; nothing where they are off."""
    if not config_of(plan.configs, PatchesConfig).active:
        return []
    tracks = plan.rig.names if plan.stage == "detection" else ()
    return [*((PATCHES[0], name) for name in tracks), *((key, "") for key in PATCHES[1:])]


class Results:
    """Takes the records of a run as they come: into the bag and skeletons.json.gz at once. What the report
    needs is kept for the end; of a live run, the newest.

    A context manager: leaving it normally writes the skeletons, leaving it with an error gives all up.

    Args:
        folder: that is there, see `result_folder`.
        on_record: called with every record that is kept, e.g. for progress.
        pictures: whether pictures follow; without them no body is kept for drawing.
    """

    def __init__(
        self, folder: Path, plan: Plan, on_record: Callable[[str, Any], None] = lambda key, record: None,
        pictures: bool = True,
    ):  # fmt: skip
        self.folder = folder
        kept = KEPT_LIVE if plan.live else None
        self.poses: deque[RefinedPoseSet] = deque(maxlen=kept)
        self.views: dict[str, deque[ViewDetections]] = {name: deque(maxlen=kept) for name in plan.rig.names}
        self.frames_in = dict.fromkeys(plan.rig.names, 0)
        self._skeletons = SkeletonStream(folder / "skeletons.json.gz", plan.skeleton.joint_names)
        model = plan.extras.get("segments")
        self._bodies = None if model is None else BodyStream(folder / "kinematics.json.gz", model)
        self.bodies = BodyTally()
        self.drawn: deque[DrawnBody] = deque(maxlen=kept if pictures else 0)
        self.clocks: dict[str, ClockModel] = {}  # the newest of every clock that was found
        self._plan = plan
        self._with_patches = config_of(plan.configs, PatchesConfig).active
        self._on_record = on_record
        self._bag = BagWriter(folder / "bag")
        self._previews = Previews()
        self._shown: set[int] = set()
        self._started = False

    def take(self, key: str, record: Any) -> None:
        """A record of the topic of that key; detections, sound, skeletons, clocks and previews of
        images are kept."""
        if key == "detections":
            when = self._plan.at(record.camera, record.stamp_ns)
            self._start(when)
            self._write(key, record, when, record.camera)
            self.views[record.camera].append(_without_maps(record))
            self.frames_in[record.camera] += 1
        elif key == SOUND_KEY:
            when = self._plan.at(TOPICS[key].of(record.device), record.stamp_ns)
            self._start(when)
            self._write(key, record, when, record.device)
        elif key == "preview":
            when = self._plan.at(record.camera, record.stamp_ns)
            self._start(when)
            self._write(key, record, when, record.camera)
        elif key == "image":
            preview = self._previews.take(record)
            if preview is not None:
                self.take("preview", preview)
        elif key == "skeletons":
            self._start(record.stamp_ns)
            self._write(key, record, record.stamp_ns)
            self._write_markers(record)
            self._skeletons.add(record)
            self.poses.append(record)
        elif key in PATCHES:
            if self._with_patches:
                self._start(record.stamp_ns)
                owner = record.camera if key == "patch_tracks" else ""
                self._write(key, record, self._plan.at(owner, record.stamp_ns), owner)
        elif key == IMU_KEY:
            self._start(record.stamp_ns)
            self._write(key, record, record.stamp_ns, record.device)
        elif key == "bodies":
            self._start(record.stamp_ns)
            self._write(key, record, record.stamp_ns)
            self.bodies.add(record)
            self.drawn.extend(drawn_bodies(record))
            if self._bodies is not None:
                self._bodies.add(record)
        elif key == "clock_models":
            self.clocks[record.device] = record
        self._on_record(key, record)

    @property
    def instants(self) -> int:
        """How many sets of skeletons there were."""
        return self._skeletons.count

    @property
    def has_something(self) -> bool:
        """Whether there were skeletons or bodies."""
        return bool(self.poses) or self.bodies.instants > 0

    def close(self) -> None:
        """Finish the skeletons, write the clocks that were found, and finish the bag."""
        self._start(0)
        self._bag.close()
        self._skeletons.close()
        if self._bodies is not None:
            self._bodies.close()
        found = {name: model for name, model in self.clocks.items() if name in self.views}
        if found:
            given = named_numbers("SyncConfig.delays_ms", config_of(self._plan.configs, SyncConfig).delays_ms)
            delays = {name: of_name(given, name) for name in self.views if of_name(given, name)}
            write_models(self.folder / "offsets.json", found, delays)

    def __enter__(self) -> Results:
        return self

    def __exit__(self, kind: type[BaseException] | None, *rest: object) -> None:
        if kind is None:
            self.close()
        else:
            self._bag.discard()
            self._skeletons.discard()
            if self._bodies is not None:
                self._bodies.discard()

    def _start(self, stamp_ns: int) -> None:
        """The latched facts stand first in the bag."""
        if not self._started:
            self._started = True
            self._write("rig", self._plan.rig, stamp_ns)
            self._write("skeleton_model", self._plan.skeleton, stamp_ns)

    def _write(self, key: str, record: Any, stamp_ns: int, owner: str = "") -> None:
        topic = "/" + TOPICS[key].of(owner)
        message = to_message(record, bag_messages(), self._plan.rig.frame_id)
        self._bag.write(topic, max(0, stamp_ns), message)

    def _write_markers(self, record: RefinedPoseSet) -> None:
        there = set(record.ids.tolist())
        message = marker_array(
            record, self._plan.skeleton, self._plan.rig.frame_id, self._shown - there, bag_messages()
        )
        self._shown = there
        self._bag.write("/" + TOPICS["markers"].name, record.stamp_ns, message)


def _without_maps(view: ViewDetections) -> ViewDetections:
    """The report needs the people alone; maps would fill the memory."""
    if view.maps is None and view.limit is None:
        return view
    return ViewDetections(
        view.camera, view.stamp_ns, view.frame_number, view.image_size, view.skeleton_hash,
        view.points, view.scores, view.person_scores, carried=view.carried,
    )  # fmt: skip
