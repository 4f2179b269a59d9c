"""Whether what is in bags can belong together."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

from panoptic_ros.domain import Rig, SkeletonModel, ViewDetections
from panoptic_ros.errors import DataError
from panoptic_ros.io.bag_streams import BagStream
from panoptic_ros.io.bags import BagReader


def check_contents(bag_of: Mapping[BagStream, BagReader], rig: Rig, skeleton: SkeletonModel) -> None:
    """Whether what comes first on every topic can be used with this rig and this skeleton.

    Raises:
        DataError: if it has another camera or skeleton.
    """
    for stream, bag in bag_of.items():
        record, camera = stream.first_record(bag), rig.camera(stream.camera)
        place = f"{stream.bag}, topic {stream.topic}"
        if record.camera != camera.name:
            raise DataError(f"{place}: detections of camera {record.camera}, not of {camera.name}")
        if isinstance(record, ViewDetections) and record.skeleton_hash != skeleton.hash:
            raise DataError(f"{place}: joints of another skeleton than {skeleton.name}")


def check_stamps(bag_of: Mapping[BagStream, BagReader], shifts: Mapping[str, int]) -> float:
    """Frames per second, if the stamps tell of instants that several cameras share.

    Args:
        shifts: by camera: what is added to its stamps, as its clock is known.

    Raises:
        DataError: if they do not.
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
