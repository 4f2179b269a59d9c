"""Plans of live runs on topics of running drivers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from panoptic_ros.errors import CalibrationError, DataError, UsageError
from panoptic_ros.io.driver_topics import DriverFile, DriverTopics, read_driver_topics
from panoptic_ros.io.messages.encodings import encoding_of, is_mosaic
from panoptic_ros.io.messages.images import is_video, video_told
from panoptic_ros.io.rigs import read_rig
from panoptic_ros.nodes.sources.drivers import Drivers, find_drivers
from panoptic_ros.running.plans.driver_rig import rig_by_calibration, rig_by_transforms, with_info
from panoptic_ros.running.plans.options import NO_OPTIONS, RunOptions
from panoptic_ros.running.plans.parameters import live_parameters, with_defaults
from panoptic_ros.running.plans.plan import Plan, require_cameras
from panoptic_ros.running.processes.children import prepare_environment

CARRIERS = {
    ("image", "sensor_msgs/msg/Image"): "image",
    ("image", "sensor_msgs/msg/CompressedImage"): "compressed_image",
    ("depth", "sensor_msgs/msg/Image"): "depth",
    ("depth", "sensor_msgs/msg/CompressedImage"): "compressed_depth",
    ("camera_info", "sensor_msgs/msg/CameraInfo"): "camera_info",
}
SENSOR_CARRIERS = {
    ("depth", "sensor_msgs/msg/Image"): "sensor_depth",
    ("depth", "sensor_msgs/msg/CompressedImage"): "compressed_sensor_depth",
    ("camera_info", "sensor_msgs/msg/CameraInfo"): "sensor_info",
}
NOT_TAKEN = ("camera_info", "sensor_info")  # read once, at the start


def plan_drivers(
    path: Path, rig: Path | None, options: RunOptions = NO_OPTIONS, fixed_frame: str = ""
) -> Plan:
    """The plan of a live run on what drivers publish.

    Args:
        path: of the topics, see `io.driver_topics`.
        rig: calibration file, of the raw images. Of rectified ones the poses are taken from it, and the rest
            from their CameraInfo. None: lenses from CameraInfo, poses from TF.
        fixed_frame: of TF, in place of what the file of topics says.

    Raises:
        UserError: on whatever the user can mend, before anything has started.
    """
    file = read_driver_topics(path)
    calibrated = None if rig is None else read_rig(rig, cameras=tuple(file.cameras))
    if calibrated is not None:
        if file.fixed_frame or fixed_frame:
            raise UsageError("a fixed frame is one of TF, which is not asked where --rig is given")
        require_cameras(calibrated.subset(file.cameras), bool(options.subjects))
    elif len(file.cameras) < (1 if options.subjects else 2):
        raise CalibrationError(
            f"{path} names {len(file.cameras)} camera, which is not enough for 3D; with --subject FILE "
            "one is enough for a body"
        )
    _check_encodings(path, file)
    skeleton, extras = options.detector()
    prepare_environment()
    file = replace(
        file,
        cameras={name: with_info(topics, calibrated is None) for name, topics in file.cameras.items()},
        sensors={name: with_info(topics, True) for name, topics in file.sensors.items()},
    )
    why = {"camera_info": ", needed without --rig"} if calibrated is None else {}
    drivers = find_drivers(
        {
            topic: f"{key} of {'depth sensor' if name in file.sensors else 'camera'} {name}{why.get(key, '')}"
            for name, topics in file.everything.items()
            for key, topic in topics.named.items()
        }
    )
    notices: list[str] = []
    carriers = _carriers(file, drivers)
    notices += [
        f"encoding {own} of camera {name} has no meaning, as its images are compressed"
        for name in carriers.get("compressed_image", ())
        if (own := file.cameras[name].encoding) and not is_mosaic(own)
    ]
    found = (
        rig_by_transforms(file, drivers, fixed_frame or file.fixed_frame, notices)
        if calibrated is None
        else rig_by_calibration(calibrated, file, drivers, notices)
    )
    return options.complete(
        Plan(
            "drivers",
            found,
            skeleton,
            with_defaults(options.all_parameters(), live_parameters(cameras=len(found))),
            extras=extras,
            topics=carriers,
            live=True,
            notices=tuple(notices),
            encodings={name: topics.encoding for name, topics in file.cameras.items() if topics.encoding},
            depth_cameras=tuple(name for name, topics in file.cameras.items() if topics.depth),
        )
    )


def _check_encodings(path: Path, file: DriverFile) -> None:
    for name, topics in file.cameras.items():
        if topics.encoding:
            encoding_of(topics.encoding, f"{path}: camera {name}")


def _carriers(file: DriverFile, drivers: Drivers) -> dict[str, dict[str, str]]:
    """Topics by key of `graph.topics.TOPICS` and owner."""
    found: dict[str, dict[str, str]] = {}
    for owners, known in ((file.cameras, CARRIERS), (file.sensors, SENSOR_CARRIERS)):
        for name, key, topic in _named(owners):
            kind = drivers.types[topic]
            if is_video(kind):
                raise DataError(f"{key} of camera {name}: {video_told(topic, kind)}")
            if (key, kind) not in known:
                expected = " or ".join(message for word, message in known if word == key)
                raise DataError(f"{topic} ({key} of camera {name}) carries {kind}; expected {expected}")
            found.setdefault(known[key, kind], {})[name] = topic
    return {key: topics for key, topics in found.items() if key not in NOT_TAKEN}


def _named(owners: Mapping[str, DriverTopics]) -> list[tuple[str, str, str]]:
    """(owner, key, topic)."""
    return [(name, key, topic) for name, topics in owners.items() for key, topic in topics.named.items()]
