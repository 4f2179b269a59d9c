"""Makes the plan of a run on bags, and checks that the content of the bags belongs together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from panoptic_ros.capture.image_size import SizePolicy
from panoptic_ros.detection.config import DetectionConfig
from panoptic_ros.domain import Rig, SkeletonModel, ViewDetections
from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.bag_streams import SOUND_KEY, BagStream
from panoptic_ros.io.bags import BagReader
from panoptic_ros.io.messages import from_message
from panoptic_ros.io.models import read_card
from panoptic_ros.io.rigs import read_rig
from panoptic_ros.io.skeletons import load_skeleton, map_joints
from panoptic_ros.params import config_of
from panoptic_ros.patches.config import PatchesConfig
from panoptic_ros.running.plans.bag_topics import (
    BagChoice,
    absent_told,
    depth_streams,
    image_streams,
    imu_streams,
    names_of,
    patch_streams,
    usable_streams,
    with_encodings,
)
from panoptic_ros.running.plans.fitting import fit_to_bags
from panoptic_ros.running.plans.imu_plan import imus_in_bags, plan_imu_bags
from panoptic_ros.running.plans.options import NO_OPTIONS, RunOptions
from panoptic_ros.running.plans.plan import Plan, require_cameras
from panoptic_ros.running.sound.bags import recorder_of, sound_streams
from panoptic_ros.running.sound.clocks import corrections_from_sound
from panoptic_ros.running.sound.use import ClockPlan, plan_clocks


def check_contents(bag_of: Mapping[BagStream, BagReader], rig: Rig, skeleton: SkeletonModel) -> None:
    """Check that the first record of every topic fits this rig and this skeleton.

    Raises:
        DataError: if a record has another camera or skeleton.
    """
    for stream, bag in bag_of.items():
        record, camera = stream.first_record(bag), rig.camera(stream.camera)
        place = f"{stream.bag}, topic {stream.topic}"
        if record.camera != camera.name:
            raise DataError(f"{place}: detections of camera {record.camera}, not of {camera.name}")
        if isinstance(record, ViewDetections) and record.skeleton_hash != skeleton.hash:
            raise DataError(f"{place}: joints of another skeleton than {skeleton.name}")


def check_stamps(bag_of: Mapping[BagStream, BagReader], shifts: Mapping[str, int]) -> float:
    """Return the frame rate, Hz, after checking that the cameras' timestamps overlap in time.

    Args:
        shifts: by camera: correction of its timestamps, ns, as far as its clock is known.

    Raises:
        DataError: if all timestamps of a topic are equal, or two cameras begin further apart than the
            recording is long.
    """
    stamps = {stream: stream.first_stamps(bag) for stream, bag in bag_of.items()}
    remedy = "add --arrival-stamps to take the times of recording"
    for stream, own in stamps.items():
        if len(own) > 1 and len(set(own)) == 1:
            raise DataError(
                f"{stream.bag}, topic {stream.topic}: all stamps are {own[0] * 1e-9:g} s; {remedy}"
            )
    begins = {stream: (own[0] + shifts.get(stream.camera, 0)) * 1e-9 for stream, own in stamps.items()}
    first, last = min(begins, key=lambda s: begins[s]), max(begins, key=lambda s: begins[s])
    apart = begins[last] - begins[first]
    length_s = max(bag.length_s for bag in bag_of.values())
    if apart > length_s:
        raise DataError(
            f"the stamps of camera {last.camera} begin {apart:.1f} s after those of {first.camera}, in "
            f"a recording of {length_s:.1f} s: their clocks differ; {remedy}, or leave one out with --cameras"
        )
    steps = sorted(b - a for a, b in pairwise(next(iter(stamps.values()))) if b > a)
    return 1e9 / steps[len(steps) // 2] if steps else 30.0


ANY = BagChoice()


def plan_bags(
    paths: Sequence[Path],
    options: RunOptions = NO_OPTIONS,
    *,
    rig: Path | Rig | None = None,
    choice: BagChoice = ANY,
    size_policy: SizePolicy = "strict",
) -> Plan:
    """Return the plan of a run on bags. It uses their detections if there are any, else their images.

    Args:
        rig: calibration, or its file, that replaces the rig in the bags.
        size_policy: policy for images whose size differs from the calibration, see `fit_camera`. A CameraInfo
            takes precedence over it.

    Raises:
        UserError: if the bags lack something, or their content cannot be used.
    """
    with ExitStack() as stack:
        bags = [stack.enter_context(BagReader(path)) for path in paths]
        if options.subjects and (alone := imus_in_bags(bags, choice)):
            return plan_imu_bags(f"bag {names_of(bags)}", alone, options)
        whole = (
            read_rig(rig, cameras=choice.cameras) if isinstance(rig, Path) else rig or _latched(bags, "rig")
        )
        if whole is None:
            raise DataError(f"{names_of(bags)} has no message on /rig; give the calibration with --rig")
        asked = whole if choice.cameras is None else whole.subset(choice.cameras)
        streams, useless = usable_streams(
            image_streams(choice, bags, asked, options.chosen_skeleton), bags, choice
        )
        streams, encoded = with_encodings(streams, bags)
        depths, unreadable = depth_streams(choice, bags, asked, streams)
        bag_of = {s: next(bag for bag in bags if bag.path == s.bag) for s in streams}
        counts = {s.camera: bag.counts[s.topic] for s, bag in bag_of.items()}
        missing = {name: absent_told(name, bags) for name in asked.names if name not in counts}
        found = asked.subset(counts)
        require_cameras(found, bool(options.subjects))
        stage = "sync" if streams[0].key == "detections" else "detection"
        extras: Mapping[str, Any] = {}
        if stage == "sync":
            skeleton = _recorded_skeleton(options, bags, bag_of)
        else:
            skeleton, extras = options.detector()
        found, fits = fit_to_bags(found, bag_of, bags, size_policy)
        check_contents(bag_of, found, skeleton)
        worn = imu_streams(bags, choice.arrival_stamps) if options.subjects else ()
        heard = sound_streams(bags, choice.arrival_stamps)
        recorders = [recorder_of(stream) for stream in heard]
        configs = configure(options.all_parameters())
        followed = config_of(configs, PatchesConfig).active
        tracks = patch_streams(choice, bags, found, streams) if followed else ()
        if options.from_sound:
            lines, told = corrections_from_sound(recorders, found, options)
            bag_of = {replace(s, line=lines.get(s.camera)): bag for s, bag in bag_of.items()}
            depths, tracks = (
                tuple(replace(s, line=lines.get(s.camera)) for s in own) for own in (depths, tracks)
            )
            clocks = ClockPlan(configs, {}, {}, told)
        else:
            stamps = {stream.camera: stream.first_stamps(bag) for stream, bag in bag_of.items()}
            clocks = plan_clocks(found, configs, recorders, stamps)
        rate = check_stamps(bag_of, clocks.shifts)
    sounds = (_begun(s, clocks.recorders) for s in heard if s.camera in clocks.recorders)
    every = [*bag_of, *depths, *tracks, *sounds, *worn]
    return options.complete(
        Plan(
            f"bag {names_of(bags)}",
            found,
            skeleton,
            clocks.configs,
            streams=tuple(replace(s, shift_ns=clocks.shifts.get(_shifted(s), 0)) for s in every),
            encodings={s.camera: s.encoding for s in streams if s.encoding},
            shifts=clocks.shifts,
            stage=stage,
            depth_cameras=tuple(s.camera for s in depths),
            extras=extras,
            frame_count=sum(counts.values()),
            instants=max(counts.values()),
            frame_rate=rate,
            notices=(
                *(line for name, line in missing.items() if name not in useless),
                *useless.values(),
                *encoded,
                *unreadable,
                *fits,
                *clocks.notices,
            ),
        )
    )


def _shifted(stream: BagStream) -> str:
    """Return the key under which `Plan.shifts` holds the shift of a stream."""
    return TOPICS[SOUND_KEY].of(stream.camera) if stream.key == SOUND_KEY else stream.camera


def _begun(stream: BagStream, begins: Mapping[str, int]) -> BagStream:
    """Return the sound stream of a device, starting at the first sample that is needed."""
    return replace(stream, from_sample=begins[stream.camera])


def _recorded_skeleton(
    options: RunOptions, bags: Sequence[BagReader], bag_of: Mapping[BagStream, BagReader]
) -> SkeletonModel:
    """Return the skeleton of recorded detections.

    2D poses from another software stack come with their own skeleton. For other detections, the result is the
    recorded /skeleton_model. Without one, it is the chosen skeleton, whose hash must match that of the
    detections.

    Raises:
        DataError: if no skeleton fits the detections.
        UsageError: if options of the detector are given, as recorded detections are used unchanged.
    """
    first, its_bag = next(iter(bag_of.items()))
    if first.people is not None:
        return first.people.model(its_bag, first.topic)
    recorded: SkeletonModel | None = _latched(bags, "skeleton_model")
    if recorded is not None:
        _refuse_detector_options(options, bags[0])
        return recorded
    stream, bag = next(iter(bag_of.items()))
    model = config_of(configure(options.all_parameters()), DetectionConfig).model
    name = options.chosen_skeleton
    named = load_skeleton(name)
    # the named skeleton with the joints that the detector provides
    filled, _ = map_joints(name, read_card(model).card.joints)
    for skeleton in (named, filled):
        if skeleton.hash == stream.first_record(bag).skeleton_hash:
            return skeleton
    raise DataError(
        f"{bag.path} has no message on /skeleton_model, and its detections do not match the output of "
        f"{model} for {named.name}; name their --skeleton and --model, or use --redetect if there are "
        "images"
    )


def _refuse_detector_options(options: RunOptions, bag: BagReader) -> None:
    if options.model or options.skeleton:
        option = "--model" if options.model else "--skeleton"
        raise UsageError(
            f"{option} has no meaning for the detections in {bag.path}, which are used unchanged; add "
            "--redetect if it has images"
        )


def _latched(bags: Sequence[BagReader], key: str) -> Any:
    """Return the first record of a latched topic; None if there is none."""
    topic = TOPICS[key]
    for bag in bags:
        for _, _, message in bag.messages("/" + topic.name) if "/" + topic.name in bag.topics else ():
            return from_message(message, topic.record)
    return None
