"""Read recorded depth maps of depth sensors with their own intrinsics, pose and clock."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from panoptic_ros.capture.depth_folder import depth_files, read_depth
from panoptic_ros.capture.source import check_stamps, exact_rate, grid_stamp
from panoptic_ros.domain import DepthFrame, DepthSensor, Rig
from panoptic_ros.errors import DataError

FRAME_RATE = 30.0  # Hz, for maps without timestamps


class DepthSensorSource:
    """Depth maps of a sensor in natural order of their file names; every iteration starts at the first.

    Args:
        sensor: Depth sensor of the rig; the maps must have its image size.
        files: uint16 in counts of the sensor's `unit_m` along its z axis, 0 = unknown.
        start_ns, frame_rate: Map i has the timestamp start_ns + i / frame_rate.
        stamps: Timestamps (ns) on the sensor's clock, one per map; they replace the frame rate.

    Raises:
        DataError: if the number of timestamps is wrong or they do not increase; while iterating, if a file is
            no depth map of the sensor.
    """

    def __init__(
        self,
        sensor: DepthSensor,
        files: Sequence[Path],
        *,
        start_ns: int = 0,
        frame_rate: float = FRAME_RATE,
        stamps: Sequence[int] | None = None,
    ):
        self.sensor, self.files = sensor, tuple(files)
        self.camera, self.image_size = sensor.name, sensor.camera.image_size
        what = f"depth maps of sensor {sensor.name}"
        rate = exact_rate(frame_rate, what)
        self.frame_rate, self.frame_count = float(rate), len(self.files)
        if stamps is None:
            stamps = [grid_stamp(int(start_ns), i, rate) for i in range(len(self.files))]
        self.stamps = check_stamps(stamps, what)
        if len(self.stamps) != len(self.files):
            raise DataError(f"there are {len(self.files)} {what} but {len(self.stamps)} stamps")

    def __iter__(self) -> Iterator[DepthFrame]:
        for number, (stamp_ns, file) in enumerate(zip(self.stamps, self.files)):
            depth = read_depth(file, self.sensor.unit_m)
            if depth.shape[::-1] != self.image_size:
                raise DataError(
                    f"depth map {file} has {depth.shape[1]} x {depth.shape[0]} pixels, but the rig states "
                    f"{self.image_size[0]} x {self.image_size[1]} for sensor {self.camera}"
                )
            yield DepthFrame(self.camera, stamp_ns, number, depth)


def open_depth_sensors(
    folder: Path,
    rig: Rig,
    *,
    start_ns: int = 0,
    frame_rate: float | None = None,
    stamps: Mapping[str, Sequence[int]] | None = None,
) -> tuple[DepthSensorSource, ...]:
    """Open the depth sensors of a rig with maps `<sensor>_depth/*.png` in a folder, in the rig's order.

    Args:
        start_ns, frame_rate: as `DepthSensorSource`; 30 Hz by default.
        stamps: timestamps (ns) by sensor, e.g. from timestamps.csv. If any are given, all of these sensors
            need them.

    Raises:
        DataError: as `DepthSensorSource`, or for a sensor without timestamps.
    """
    sources = []
    rate = FRAME_RATE if frame_rate is None else frame_rate
    for sensor in rig.depth_sensors:
        files = depth_files(folder, sensor.name)
        if not files:
            continue
        if stamps and sensor.name not in stamps:
            there = ", ".join(sorted(stamps))
            raise DataError(f"timestamps.csv has stamps for {there} but none for depth sensor {sensor.name}")
        own = stamps[sensor.name] if stamps else None
        sources.append(DepthSensorSource(sensor, files, start_ns=start_ns, frame_rate=rate, stamps=own))
    return tuple(sources)
