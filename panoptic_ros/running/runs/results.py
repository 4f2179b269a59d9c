"""Records the output of a run as it arrives: the bag, the skeletons and the bodies."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Protocol

from panoptic_ros.domain import ClockModel, PoseSet, RefinedPoseSet, Rig, ViewDetections
from panoptic_ros.errors import ContractError, DataError, PanopticError
from panoptic_ros.evaluation.body_tally import BodyTally
from panoptic_ros.graph.topics import TOPICS, owner_of
from panoptic_ros.io.bag_recorder import BagRecorder
from panoptic_ros.io.bags import RESULT_BAG, BagWriter
from panoptic_ros.io.body_files import BodyStream
from panoptic_ros.io.clock_files import write_models
from panoptic_ros.io.definitions import described
from panoptic_ros.io.messages import bag_messages, to_message
from panoptic_ros.io.messages.family import bag_typestore
from panoptic_ros.io.messages.markers import marker_array
from panoptic_ros.io.plain_formats import SkeletonStream
from panoptic_ros.io.previews import Previews
from panoptic_ros.io.rigs import write_rig
from panoptic_ros.params import config_of
from panoptic_ros.running.plans.plan import Plan
from panoptic_ros.stamps.delays import NO_DELAY, delay_of, named_delays
from panoptic_ros.sync.config import SyncConfig
from panoptic_ros.view.body_drawing import DrawnBody, drawn_bodies

KEPT_LIVE = 3600  # instants that the report of a live run covers, as the run has no end; 2 min
KEPT_FREE = 2_000_000  # bytes that a live take leaves free on the disk, for the index of its bag (one hour)
BAG, SKELETONS, BODIES, CLOCKS = RESULT_BAG, "skeletons.json.gz", "kinematics.json.gz", "offsets.json"
REPAIRED, SKELETONS_AT = "rig_repaired.json", "skeletons_at.json.gz"
# files and folders that a run writes before its end
MADE = (
    BAG,
    SKELETONS,
    SKELETONS_AT,
    BODIES,
    CLOCKS,
    REPAIRED,
    "rig.json",
    "launch.json",
    "occluders.json",
    "logs",
)


class BagSink(Protocol):
    """Receiver of the messages of a run."""

    def write(self, topic: str, stamp_ns: int, message: Any) -> None:
        """Append a message of the family `bag_messages()`."""

    def close(self) -> None:
        """Complete and close the bag."""

    def discard(self) -> None:
        """Close the bag after an error."""


class TakeBag:
    """Bag of a live take. A `BagRecorder` writes it in place and syncs it to the disk in a separate thread.

    Args:
        beside: callback that writes the files beside the bag to the disk, see `BagRecorder`.
    """

    def __init__(self, path: Path, beside: Callable[[], None]):
        self._recorder = BagRecorder(path, keep_free=KEPT_FREE, beside=beside)

    @property
    def fault(self) -> PanopticError | None:
        """Return the error that ended the bag early, e.g. a full disk; None = no error."""
        return self._recorder.fault

    @property
    def dropped(self) -> int:
        """Return the number of messages that were dropped because the disk was too slow."""
        return sum(self._recorder.dropped.values())

    def write(self, topic: str, stamp_ns: int, message: Any) -> None:
        """Append a message, see `BagSink`.

        Raises:
            ContractError: if the message type has no definition.
        """
        kind = message.__msgtype__
        connection = described(topic, kind)
        if connection is None:
            raise ContractError(f"there is no definition of {kind}")
        self._recorder.put(connection, stamp_ns, bytes(bag_typestore().serialize_cdr(message, kind)))

    def close(self) -> None:
        """Complete and close the bag, see `BagSink`."""
        self._recorder.close()

    def discard(self) -> None:
        """Close the bag as far as possible. Messages that were recorded stay."""
        self._recorder.close()


def is_kept(configs: Mapping[str, Any], key: str) -> bool:
    """Return whether the bag of a run contains the topic with this key; see `graph.topics.Topic`."""
    topic = TOPICS.get(key)
    stage, _, parameter = ("" if topic is None else topic.kept).partition(".")
    return stage == "always" or (parameter != "" and bool(getattr(configs[stage], parameter)))


def kept_besides(plan: Plan) -> list[tuple[str, str]]:
    """Return (key, owner) of the additional topics that a run keeps.

    Detections, sound, IMU samples, skeletons and bodies are always kept and not listed.
    """
    found: list[tuple[str, str]] = []
    for key, topic in TOPICS.items():
        if topic.kept != "always" and is_kept(plan.configs, key):
            owners = plan.rig.names if plan.stage == "detection" else ()
            found += [(key, name) for name in (owners if topic.scope == "camera" else ("",))]
    return found


def check_record(plan: Plan, key: str, owner: str, record: Any) -> None:
    """Check that a record from outside belongs to this run.

    Args:
        owner: the camera or device of the topic; "" for topics of the graph.

    Raises:
        DataError: if the record is of another camera, device, skeleton or set of segments.
    """
    if owner and owner_of(key, record) != owner:
        raise DataError(f"it is of {owner_of(key, record)!r}, and the topic is of {owner!r}")
    skeleton = getattr(record, "skeleton_hash", plan.skeleton.hash)
    if skeleton != plan.skeleton.hash:
        raise DataError(f"its skeleton has hash {skeleton}, and that of this run {plan.skeleton.hash}")
    joints = len(plan.skeleton.joint_names)
    if isinstance(record, PoseSet) and record.positions.shape[1] != joints:
        raise DataError(f"its people have {record.positions.shape[1]} joints, and those of this run {joints}")
    model = plan.extras.get("segments")
    if key == "bodies" and model is not None and tuple(record.segment_names) != tuple(model.names):
        raise DataError(f"its {len(record.segment_names)} segments are not those of this run")


class Results:
    """Receiver of the records of a run.

    Records go to the bag and to the files of frames (e.g. skeletons.json.gz) at once. Input of the report is
    kept until the end; in a live run, only the newest `KEPT_LIVE` instants are kept.

    The object is a context manager. A normal exit closes all files. An exit by an error discards the results
    of a recording, but closes those of a live take.

    Args:
        folder: existing folder, see `running.runs.result_folder`.
        on_record: callback with the key and the record, called for every record, e.g. for progress.
        pictures: whether pictures follow. Without them, no body is kept for drawing.
    """

    def __init__(
        self,
        folder: Path,
        plan: Plan,
        on_record: Callable[[str, Any], None] = lambda key, record: None,
        pictures: bool = True,
    ):
        self.folder = folder
        kept = KEPT_LIVE if plan.live else None
        self.poses: deque[RefinedPoseSet] = deque(maxlen=kept)
        self.views: dict[str, deque[ViewDetections]] = {name: deque(maxlen=kept) for name in plan.rig.names}
        self.frames_in = dict.fromkeys(plan.rig.names, 0)
        self._skeletons = SkeletonStream(folder / SKELETONS, plan.skeleton.joint_names)
        self._streams: dict[str, SkeletonStream | BodyStream] = {"skeletons": self._skeletons}
        if is_kept(plan.configs, "skeletons_at"):
            self._streams["skeletons_at"] = SkeletonStream(folder / SKELETONS_AT, plan.skeleton.joint_names)
        model = plan.extras.get("segments")
        if model is not None:
            self._streams["bodies"] = BodyStream(folder / BODIES, model)
        self.bodies = BodyTally()
        self.drawn: deque[DrawnBody] = deque(maxlen=kept if pictures else 0)
        self.clocks: dict[str, ClockModel] = {}  # newest model of every clock that was found
        self.repaired: Rig | None = None  # the newest corrected rig
        self._plan = plan
        self._on_record = on_record
        self._take_bag = TakeBag(folder / BAG, self._sync) if plan.live else None
        self._bag: BagSink = self._take_bag or BagWriter(folder / BAG)
        self._previews = Previews()
        self._shown: set[int] = set()
        self._started = False

    def take(self, key: str, record: Any) -> None:
        """Receive a record of the topic with that key.

        Detections, sound, skeletons, clock models and previews of images are kept.
        """
        if key == "image":
            preview = self._previews.take(record)
            if preview is not None:
                self.take("preview", preview)
        elif key == "clock_models":
            self.clocks[record.device] = record
        elif key == "repaired_rig":
            self.repaired = record
        elif is_kept(self._plan.configs, key):
            self._keep(key, record)
        if key == "detections":
            self.views[record.camera].append(_without_maps(record))
            self.frames_in[record.camera] += 1
        elif key == "skeletons":
            self._write_markers(record)
            self.poses.append(record)
        elif key == "bodies":
            self.bodies.add(record)
            self.drawn.extend(drawn_bodies(record))
        if key in self._streams:
            self._streams[key].take(record)
        self._on_record(key, record)

    def _keep(self, key: str, record: Any) -> None:
        """Write a record to the bag, at its timestamp on the master clock."""
        owner, topic = owner_of(key, record), TOPICS[key]
        clock = topic.of(owner) if topic.scope == "device" else owner
        when = record.stamp_ns if topic.scope == "imu" else self._plan.at(clock, record.stamp_ns)
        self._start(when)
        self._write(key, record, when, owner)

    @property
    def instants(self) -> int:
        """Return the number of skeleton sets."""
        return self._skeletons.count

    @property
    def recorded(self) -> bool:
        """Return whether any record was written."""
        return self._started

    @property
    def fault(self) -> PanopticError | None:
        """Return the error that ended a live take early, e.g. a full disk; None = no error."""
        return None if self._take_bag is None else self._take_bag.fault

    @property
    def dropped(self) -> int:
        """Return the number of messages of a live take that were dropped because the disk was too slow."""
        return 0 if self._take_bag is None else self._take_bag.dropped

    def close(self) -> None:
        """Complete the bag, the skeletons and the bodies, and write the clock models that were found.

        Raises:
            PanopticError: if a file cannot be completed. All other files are completed nevertheless.
        """
        self._start(0)
        with ExitStack() as stack:  # closes each file, even if another one fails
            stack.callback(self._write_clocks)
            if self.repaired is not None:
                stack.callback(write_rig, self.folder / REPAIRED, self.repaired)
            for stream in reversed(self._streams.values()):
                stack.callback(stream.close)
            stack.callback(self._bag.close)

    def _sync(self) -> None:
        """Write the files beside the bag of a live take to the disk."""
        for stream in self._streams.values():
            stream.sync()

    def _write_clocks(self) -> None:
        found = {name: model for name, model in self.clocks.items() if name in self.views}
        if found:
            given = named_delays("SyncConfig.delays_ms", config_of(self._plan.configs, SyncConfig).delays_ms)
            delays = {name: delay_of(given, name) for name in self.views}
            delays = {name: delay for name, delay in delays.items() if delay != NO_DELAY}
            write_models(self.folder / CLOCKS, found, delays)

    def __enter__(self) -> Results:
        return self

    def __exit__(self, kind: type[BaseException] | None, *rest: object) -> None:
        if kind is None or self._plan.live:
            self.close()
        else:
            self._bag.discard()
            for stream in self._streams.values():
                stream.discard()

    def _start(self, stamp_ns: int) -> None:
        """Write the latched records (rig and skeleton model) to the bag, before any other record."""
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
    """Return a view without its score maps.

    The report needs only the 2D poses, and maps would fill the memory.
    """
    if view.maps is None and view.limit is None:
        return view
    return ViewDetections(
        view.camera,
        view.stamp_ns,
        view.frame_number,
        view.image_size,
        view.skeleton_hash,
        view.points,
        view.scores,
        view.person_scores,
        carried=view.carried,
    )
