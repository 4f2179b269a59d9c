"""Shortens the plan of a recording to its first seconds after the first timestamp of its cameras."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice

from panoptic_ros.capture import open_source
from panoptic_ros.capture.imus import imu_samples
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.bag_streams import SOUND_KEY, BagStream
from panoptic_ros.io.bags import BagReader
from panoptic_ros.running.plans.plan import Plan

SECOND = 1_000_000_000
CAMERAS = ("image", "compressed_image", "detections")  # bag streams that define the start of a recording


def ended_after(plan: Plan, duration_s: float) -> Plan:
    """Return the plan of the first seconds of a recording, counted from its first timestamp.

    Timestamps are compared with the clock corrections that the plan knows. A recording of IMUs alone begins
    with its first sample.

    Raises:
        UserError: if a source cannot be opened.
    """
    first = list(begins(plan))
    if not first:
        return plan
    until = min(first) + round(duration_s * SECOND)
    frames = math.ceil(duration_s * plan.frame_rate)
    sound = TOPICS[SOUND_KEY]
    return replace(
        plan,
        until_ns=until,
        sources={
            name: {**source, "until_ns": until - plan.shifts.get(name, 0)}
            for name, source in plan.sources.items()
        },
        streams=tuple(replace(stream, until_ns=until - stream.shift_ns) for stream in plan.streams),
        sounds=tuple(
            {**own, "until_ns": until - plan.shifts.get(sound.of(str(own["device"])), 0)}
            for own in plan.sounds
        ),
        instants=_at_most(plan.instants, frames),
        frame_count=_at_most(plan.frame_count, frames * max(1, len(plan.rig))),
    )


def _at_most(count: int | None, most: int) -> int | None:
    return None if count is None else min(count, most)


def begins(plan: Plan) -> Iterator[int]:
    """Yield the timestamp, ns, of the first record of each camera; without cameras, of each IMU."""
    for camera, description in plan.sources.items():
        source, _ = open_source(camera, plan.rig, description)
        with source:
            yield from (plan.at(camera, frame.stamp_ns) for frame in islice(source, 1))
    streams = [stream for stream in plan.streams if stream.key in CAMERAS] or list(plan.streams)
    yield from (stamp for stream in streams for stamp in _first_stamp(stream))
    if not plan.rig.cameras:
        for device, path in plan.imus.items():
            yield from (sample.stamp_ns for sample in islice(imu_samples(path, [device]), 1))


def _first_stamp(stream: BagStream) -> list[int]:
    with BagReader(stream.bag) as bag:
        return [stamp + stream.shift_ns for stamp in stream.first_stamps(bag)[:1]]
