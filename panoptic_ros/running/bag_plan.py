"""The plan of a run on bags: which topics are whose, and whether they can belong together."""
from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from itertools import pairwise
from typing import Any

from panoptic_ros.domain import Rig, SkeletonModel, ViewDetections
from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.bag_streams import DEPTH_KEYS, BagStream
from panoptic_ros.io.bags import BagReader
from panoptic_ros.io.messages import from_message
from panoptic_ros.io.models import read_card
from panoptic_ros.io.rigs import read_rig
from panoptic_ros.io.skeletons import DEFAULT_SKELETON, load_skeleton, map_joints
from panoptic_ros.running.plan import Plan, find_detector, pairs, require_two

KEYS = ("detections", "image", "compressed_image")  # what a run can begin with, the best first


def bag_plan(args: argparse.Namespace, parameters: dict[str, Any]) -> Plan:
    """Detections of the bags if they have them, else their images.

    Raises:
        UserError: if the bags lack something, or what is in them cannot be used.
    """
    with ExitStack() as stack:
        bags = [stack.enter_context(BagReader(path)) for path in args.bag]
        rig = read_rig(args.rig) if args.rig else _latched(bags, "rig")
        if rig is None:
            raise DataError(f"{_names(bags)} has no message on /rig; give the calibration with --rig")
        if args.cameras:
            rig = rig.subset(args.cameras.split(","))
        streams = _streams(args, bags, rig)
        depths, unreadable = _depths(args, bags, rig, streams)
        bag_of = {s: next(bag for bag in bags if bag.path == s.bag) for s in streams}
        counts = {s.camera: bag.counts[s.topic] for s, bag in bag_of.items()}
        absent = [name for name in rig.names if name not in counts]
        rig = rig.subset(counts)
        require_two(rig)
        stage = "sync" if streams[0].key == "detections" else "detection"
        if stage == "sync":
            skeleton, extras = _recorded_skeleton(args, parameters, bags, bag_of), {}
        else:
            skeleton, extras = find_detector(parameters, args.skeleton)
        _check_contents(bag_of, rig, skeleton)
        rate = _check_stamps(bag_of)
    return Plan(
        f"bag {_names(bags)}", rig, skeleton, configure(parameters), streams=streams + depths, stage=stage,
        depth_cameras=tuple(s.camera for s in depths), extras=extras, frame_count=sum(counts.values()),
        instants=max(counts.values()), frame_rate=rate,
        notices=(*(f"camera {name} of the rig is not in the bag" for name in absent), *unreadable),
    )  # fmt: skip


def _streams(args: argparse.Namespace, bags: Sequence[BagReader], rig: Rig) -> tuple[BagStream, ...]:
    """The streams of the best kind there is, in the order of the rig's cameras."""
    given = pairs(args.topic, "--topic")
    for camera in given:
        rig.camera(camera)  # a wrong name is told
    for key in KEYS[1:] if args.redetect else KEYS:
        found = _of_kind(args, bags, key, rig.names, given)
        if found:
            return found
    missing = [topic for topic in given.values() if not any(topic in bag.topics for bag in bags)]
    raise DataError(
        f"{_names(bags)} has {f'no topic {missing[0]}' if missing else 'no images and no detections'} of the "
        f"cameras {', '.join(rig.names)}; name their topics with --topic CAMERA=TOPIC; there are "
        f"{', '.join(sorted({t for bag in bags for t in bag.topics})) or 'no topics'}"
    )


def _depths(
    args: argparse.Namespace, bags: Sequence[BagReader], rig: Rig, streams: Sequence[BagStream]
) -> tuple[tuple[BagStream, ...], list[str]]:
    """The streams of depth maps of cameras with images, and a line for each that cannot be read."""
    given = pairs(args.depth_topic, "--depth-topic")
    for camera in given:
        rig.camera(camera)  # a wrong name is told
    cameras = [stream.camera for stream in streams if stream.key != "detections"]  # which know their depth
    found = {s.camera: s for key in DEPTH_KEYS for s in _of_kind(args, bags, key, cameras, given)}
    for camera, topic in given.items():
        if camera not in found:
            raise DataError(f"{_names(bags)}: no images of camera {camera}, or no depth maps on {topic}")
    readable, problems = [], []
    for stream in found.values():
        try:
            stream.first_record(next(bag for bag in bags if bag.path == stream.bag))
            readable.append(stream)
        except DataError as error:
            problems.append(f"camera {stream.camera} goes without its depth maps: {error}")
    return tuple(readable), problems


def _of_kind(
    args: argparse.Namespace, bags: Sequence[BagReader], key: str, cameras: Sequence[str],
    given: Mapping[str, str],
) -> tuple[BagStream, ...]:  # fmt: skip
    """The streams of one kind that there are."""
    places = {camera: _find(bags, key, camera, given.get(camera)) for camera in cameras}
    return tuple(
        BagStream(bag.path, topic, camera, key, args.arrival_stamps)
        for camera, (bag, topic) in places.items() if topic
    )  # fmt: skip


def _find(bags: Sequence[BagReader], key: str, camera: str, given: str | None) -> tuple[BagReader, str]:
    """The bag and the topic of that kind of a camera; the topic is empty if there is none.

    A topic of the right type that ends as the camera's own does is taken for it, so that recordings of a
    graph in a namespace need nothing more.
    """
    kind, usual = TOPICS[key].message, "/" + TOPICS[key].of(camera)
    rows = [
        (bag, topic) for bag in bags for topic, own in bag.topics.items() if own == kind and bag.counts[topic]
    ]
    if given is not None:
        found = [row for row in rows if row[1] == given]
    else:
        found = [row for row in rows if row[1] == usual] or [row for row in rows if row[1].endswith(usual)]
    if len(found) > 1:
        option = "--depth-topic" if key in DEPTH_KEYS else "--topic"
        places = " and ".join(f"{topic} in {bag.path}" for bag, topic in found[:2])
        raise DataError(f"camera {camera} may be {places}; choose with {option} {camera}=TOPIC or other bags")
    return found[0] if found else (bags[0], "")


def _check_contents(bag_of: Mapping[BagStream, BagReader], rig: Rig, skeleton: SkeletonModel) -> None:
    """Whether what comes first on every topic can be used with this rig and this skeleton."""
    for stream, bag in bag_of.items():
        record, camera = stream.first_record(bag), rig.camera(stream.camera)
        place = f"{stream.bag}, topic {stream.topic}"
        if record.image_size != camera.image_size:
            width, height = record.image_size
            raise DataError(
                f"{place}: images of {width} x {height}, but camera {camera.name} is calibrated for "
                f"{camera.image_size[0]} x {camera.image_size[1]}"
            )
        if record.camera != camera.name:
            raise DataError(f"{place}: detections of camera {record.camera}, not of {camera.name}")
        if isinstance(record, ViewDetections) and record.skeleton_hash != skeleton.hash:
            raise DataError(f"{place}: joints of another skeleton than {skeleton.name}")


def _check_stamps(bag_of: Mapping[BagStream, BagReader]) -> float:
    """Frames per second, if the stamps tell of instants that several cameras share."""
    stamps = {stream: stream.first_stamps(bag) for stream, bag in bag_of.items()}
    remedy = "add --arrival-stamps to take the times of recording"
    for stream, own in stamps.items():
        if len(own) > 1 and len(set(own)) == 1:
            raise DataError(
                f"{stream.bag}, topic {stream.topic}: all stamps are {own[0] * 1e-9:g} s; {remedy}"
            )
    begins = {stream: own[0] * 1e-9 for stream, own in stamps.items()}
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


def _recorded_skeleton(
    args: argparse.Namespace, parameters: dict[str, Any], bags: Sequence[BagReader],
    bag_of: Mapping[BagStream, BagReader],
) -> SkeletonModel:  # fmt: skip
    """The skeleton of detections; the one that is named if /skeleton_model was not recorded."""
    recorded: SkeletonModel | None = _latched(bags, "skeleton_model")
    if recorded is not None:
        _refuse_detector_options(args)
        return recorded
    stream, bag = next(iter(bag_of.items()))
    model = configure(parameters)["detection"].model  # type: ignore[attr-defined]
    named = load_skeleton(args.skeleton)
    filled, _ = map_joints(args.skeleton, read_card(model).card.joints)  # as a detector's joints allow
    for skeleton in (named, filled):
        if skeleton.hash == stream.first_record(bag).skeleton_hash:
            return skeleton
    raise DataError(
        f"{bag.path} has no message on /skeleton_model, and its detections are not what {model} gives "
        f"for {named.name}; name their --skeleton and --model, or use --redetect if there are images"
    )


def _refuse_detector_options(args: argparse.Namespace) -> None:
    if args.model or args.skeleton != DEFAULT_SKELETON:
        option = "--model" if args.model else "--skeleton"
        raise UsageError(
            f"{option} has no meaning for the detections in {args.bag[0]}, which are used as they are; add "
            "--redetect if it has images"
        )


def _latched(bags: Sequence[BagReader], key: str) -> Any:
    """The first record on a latched topic, None if there is none."""
    topic = TOPICS[key]
    for bag in bags:
        for _, _, message in bag.messages("/" + topic.name) if "/" + topic.name in bag.topics else ():
            return from_message(message, topic.record)
    return None


def _names(bags: Sequence[BagReader]) -> str:
    return " and ".join(str(bag.path) for bag in bags)
