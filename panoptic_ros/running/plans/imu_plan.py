"""Makes plans of runs without cameras, which solve for bodies of designated people from IMUs alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from panoptic_ros.capture.imus import imu_devices
from panoptic_ros.domain import NO_CAMERAS
from panoptic_ros.errors import UsageError
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.bag_streams import BagStream
from panoptic_ros.io.bags import BagReader
from panoptic_ros.io.skeletons import load_skeleton
from panoptic_ros.running.plans.bag_topics import KEYS, BagChoice, imu_streams
from panoptic_ros.running.plans.options import RunOptions
from panoptic_ros.running.plans.plan import BODIES, Plan

ALONE = (
    "no camera: bodies are solved from IMUs alone; poses are reliable, but positions drift unless a "
    "foot stands"
)


def plan_imu_file(title: str, options: RunOptions) -> Plan:
    """Return the plan of a run on the file of IMU samples that the options name.

    Raises:
        UserError: if there is no subject, or no subject wears one of the devices.
    """
    assert options.imus is not None
    return _checked(options.complete(_plan(title, options)), imu_devices(options.imus))


def imus_in_bags(bags: Sequence[BagReader], choice: BagChoice) -> tuple[BagStream, ...]:
    """Return the IMU streams of bags without camera topics; nothing if there are camera topics."""
    messages = {TOPICS[key].message for key in KEYS}
    if any(bag.counts[topic] and kind in messages for bag in bags for topic, kind in bag.topics.items()):
        return ()
    return imu_streams(bags, choice.arrival_stamps)


def plan_imu_bags(title: str, streams: tuple[BagStream, ...], options: RunOptions) -> Plan:
    """Return the plan of a run on IMUs in bags. Errors are those of `plan_imu_file`."""
    plan = options.complete(replace(_plan(title, options), streams=streams))
    return _checked(plan, [stream.camera for stream in streams])


def plan_live_imus(options: RunOptions) -> Plan:
    """Return the plan of a live run on /<device>/imu of all devices that the subjects wear.

    Errors are those of `plan_imu_file`.
    """
    plan = options.complete(replace(_plan("IMUs", options), live=True))
    return _checked(plan, ["/<device>/imu"])


def _plan(title: str, options: RunOptions) -> Plan:
    if not options.subjects:
        raise UsageError(
            "IMUs without cameras need --subject FILE, which states the devices that a person wears"
        )
    configs = configure(options.all_parameters())
    skeleton = load_skeleton(options.chosen_skeleton)
    return Plan(title, NO_CAMERAS, skeleton, configs, stage=BODIES, notices=(ALONE,))


def _checked(plan: Plan, there: Sequence[str]) -> Plan:
    if not plan.imu_devices:
        files = ", ".join(str(path) for path in plan.subjects)
        raise UsageError(
            f"no subject wears any of {', '.join(there)}: {files} has no such `devices`, and without "
            "cameras there is no other measurement of a body"
        )
    return plan


def hint_without_images(folder: Path) -> str:
    """Return a hint about other uses of a folder without images and videos; "" if there is none."""
    if (folder / "bag").is_dir():
        return f"; it has a bag: panoptic run --bag {folder / 'bag'}"
    if any((folder / f"detections.json{end}").is_file() for end in ("", ".gz")):
        return (
            "; for its 2D people: panoptic solve --rig R --detections D --out S, or panoptic kinematics "
            "with --imu and --subject"
        )
    return ""
