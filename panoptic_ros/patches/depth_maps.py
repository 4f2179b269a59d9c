"""Depth maps of sensors near people, and the check of which sensors are reliable.

Sensors stand anywhere and measure at any time of the master clock; no map is registered to a camera. A map
counts for instants within 40 ms of it. A sensor is left out while its maps do not meet the people that
cameras see, for example with a wrong scale or pose.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from panoptic_ros.domain import Camera, DepthFrame, Rig, TrackedPoseSet
from panoptic_ros.domain.parts import Part
from panoptic_ros.errors import DataError
from panoptic_ros.patches.depth_buffer import SensorDepthMap
from panoptic_ros.patches.lifting import Capsules
from panoptic_ros.stage import Notice

Array = np.ndarray
KEPT = 4  # number of newest maps that are kept for a sensor
NEAR_NS = 40_000_000  # ns, maximum time from a depth map to the instant for which it is used
SILENT_NS = 1_000_000_000  # time without a map after which a sensor is reported as silent
WINDOW = 2  # px to each side of a point, window of which the nearest surface counts
FREE = 0.02  # m, least distance of a free point in front of the surface
KNOWN = 9  # least number of the 25 px of a window with a known depth
MEETS = 0.1  # m, greatest distance between a surface and the capsule that it meets
FEWEST = 6  # least number of points on people to judge a map
MEMORY = 0.2  # weight of the newest map in the running share of points that meet people
LIES, TRUE = 0.25, 0.4  # share up to which a sensor in use is left out; share above which one is used


class DepthMaps:
    """Newest maps of all depth sensors, and the reliability of each sensor."""

    def __init__(self, rig: Rig):
        self.cameras = {sensor.name: sensor.camera for sensor in rig.depth_sensors}
        self._planes = {name: _plane(camera) for name, camera in self.cameras.items()}
        self.forget()

    def forget(self) -> None:
        """Forget all maps, and which sensors are reliable."""
        self.maps: dict[str, deque[DepthFrame]] = {}
        self.shares: dict[str, float] = {}  # running share of points on people that the maps meet
        self.believed: dict[str, bool] = {}
        self.meets: dict[str, bool] = {}  # whether the newest map alone meets people
        self.told: set[str] = set()  # sensors that are reported as silent

    def take(self, item: DepthFrame) -> None:
        """Add a map; maps that are older than the newest one are dropped.

        Raises:
            DataError: if the rig has no such sensor, or the map has another size.
        """
        camera = self.cameras.get(item.camera)
        if camera is None:
            raise DataError(f"a map of depth sensor {item.camera}, which is not in the rig")
        if item.image_size != camera.image_size:
            found, size = ("{} x {}".format(*size) for size in (item.image_size, camera.image_size))
            raise DataError(f"a map of depth sensor {item.camera} has {found} px, but the rig states {size}")
        own = self.maps.setdefault(item.camera, deque(maxlen=KEPT))
        if not own or item.stamp_ns > own[-1].stamp_ns:
            own.append(item)

    def near(self, stamp_ns: int) -> list[tuple[int, SensorDepthMap]]:
        """Return the timestamp and the map nearest to an instant, for each reliable sensor."""
        return [
            found
            for name, found in self.nearest(stamp_ns)
            if self.believed.get(name, False) and self.meets.get(name, False)
        ]

    def nearest(self, stamp_ns: int) -> list[tuple[str, tuple[int, SensorDepthMap]]]:
        """Return the same for all sensors, with their names, regardless of reliability."""
        found = []
        for name in sorted(self.maps):
            item = min(self.maps[name], key=lambda item: abs(item.stamp_ns - stamp_ns))
            if abs(item.stamp_ns - stamp_ns) <= NEAR_NS:
                found.append((name, (item.stamp_ns, self._sensed(item))))
        return found

    def _sensed(self, item: DepthFrame) -> SensorDepthMap:
        depth = np.ascontiguousarray(item.depth)
        depth.flags.writeable = False
        return SensorDepthMap(self.cameras[item.camera], self._planes[item.camera], depth)

    def judge(self, stamp_ns: int, capsules: Capsules) -> tuple[Notice, ...]:
        """Compare the maps of an instant with the people there, and update which sensors are reliable.

        Returns:
            one notice for each change: a sensor is left out or used again, is silent or gives maps again.
        """
        notices = []
        for name, (_, sensed) in self.nearest(stamp_ns):
            share = meeting(sensed, capsules)
            if not np.isfinite(share):
                continue
            self.meets[name] = share > LIES
            before = self.shares.get(name)
            now = share if before is None else before + MEMORY * (share - before)
            self.shares[name] = now
            was = self.believed.get(name)
            self.believed[name] = now > (LIES if was else TRUE)
            if self.believed[name] == (was is not False):
                continue
            whose = {"device": name}
            text = (
                f"depth sensor {name}: {now:.0%} of the people that cameras see agree with its measurements"
            )
            if self.believed[name]:
                notices.append(Notice("patches.depth_back", "info", f"{text}; it is used again", whose))
            else:
                hint = "; it is left out: check its unit, pose and clock"
                notices.append(Notice("patches.depth_lies", "warning", text + hint, whose))
        for name, own in self.maps.items():
            silent, whose = stamp_ns - own[-1].stamp_ns > SILENT_NS, {"device": name}
            if silent and name not in self.told:
                text = f"depth sensor {name} sends no maps: patches continue without it"
                notices.append(Notice("patches.depth_silent", "warning", text, whose))
            elif not silent and name in self.told:
                text = f"depth sensor {name} sends maps again"
                notices.append(Notice("patches.depth_again", "info", text, whose))
            (self.told.add if silent else self.told.discard)(name)
        return tuple(notices)


def _plane(camera: Camera) -> Array:
    """Return the pixels of a sensor on the plane at distance 1: (h, w, 2)."""
    width, height = camera.image_size
    rows, columns = np.indices((height, width))
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 2).astype(float)
    plane: Array = camera.intrinsics.undistort(pixels).reshape(height, width, 2)
    return plane


def meeting(sensed: SensorDepthMap, capsules: Capsules) -> float:
    """Return the share of points on people whose surface a map measures at the expected depth.

    It is NaN if too few points have a known depth.

    Args:
        capsules: Parts of the people; three points on each axis are tested.
    """
    shares = np.array([0.2, 0.5, 0.8])[:, None, None]
    axis = (capsules.firsts + shares * (capsules.lasts - capsules.firsts)).reshape(-1, 3)
    places = sensed.camera.cam_from_world.apply(axis)
    radii = np.tile(capsules.radii, 3)
    depths, known = _window(sensed, axis)
    there = known & np.isfinite(depths)
    if there.sum() < FEWEST:
        return float("nan")
    missed = np.abs(depths - (places[:, 2] - radii))[there]
    return float((missed < MEETS).mean())


def in_front(sensed: SensorDepthMap, points: Array) -> Array:
    """Return which points (N, 3) m are in free space: in front of every surface in the window (N,).

    Holes are unknown, never free. Joo et al. 2017, 6.2, test one pixel only. With the noise of this pixel,
    and of joints on thin limbs, one true joint in twenty would be an outlier.
    """
    depths, known = _window(sensed, points)
    places = sensed.camera.cam_from_world.apply(points)[:, 2]
    free: Array = known & (places > 0.0) & (places < depths - FREE)
    return free


def _window(sensed: SensorDepthMap, points: Array) -> tuple[Array, Array]:
    """Return the smallest depth (N,) m in a window round each point (N, 3) m, and whether it is known.

    It is known if enough pixels of the window have a depth.
    """
    height, width = sensed.depth.shape
    pixels, inside = sensed.camera.project(np.nan_to_num(points))
    at = np.floor(np.nan_to_num(pixels) + 0.5)
    inside &= np.isfinite(points).all(axis=1)
    inside &= ((at >= WINDOW) & (at < np.array([width, height]) - WINDOW)).all(axis=1)
    at = np.where(inside[:, None], at, WINDOW).astype(int)
    offsets = np.arange(-WINDOW, WINDOW + 1)
    window = sensed.depth[at[:, 1, None, None] + offsets[:, None], at[:, 0, None, None] + offsets]
    good = np.isfinite(window) & (window > 0.0)
    smallest = np.where(good, window, np.inf).min(axis=(1, 2))
    return smallest, inside & (good.sum(axis=(1, 2)) >= KNOWN)


def free_joints(
    depth: DepthMaps, parts: tuple[Part, ...], before: TrackedPoseSet, item: TrackedPoseSet, last: Array
) -> Array:
    """Return ids and joints (F, 2) that a reliable sensor finds in free space (Joo et al. 2017, 6.2).

    These joints are outliers. Joint positions are interpolated between the two sets to the timestamp of the
    map. Joints of the face lie on the surface, so they are not tested.

    Args:
        depth: Maps of the sensors.
        parts: Parts of the skeleton.
        before, item: The previous set and the present one.
        last: (F, 2) free joints of the previous set; their motion is taken as 0.
    """
    row_of = {number: row for row, number in enumerate(before.ids.tolist())}
    rows = np.array([row_of.get(number, -1) for number in item.ids.tolist()], np.int64)
    moved = np.zeros_like(item.positions)
    known = rows >= 0
    moved[known] = np.nan_to_num(item.positions[known] - before.positions[rows[known]])
    own_row = {number: row for row, number in enumerate(item.ids.tolist())}
    for person, joint in last.tolist():
        if person in own_row:
            moved[own_row[person], joint] = 0.0
    free = np.zeros(item.positions.shape[:2], bool)
    for stamp_ns, sensed in depth.near(item.stamp_ns):
        share = (item.stamp_ns - stamp_ns) / (item.stamp_ns - before.stamp_ns)
        places = item.positions - share * moved
        free |= in_front(sensed, places.reshape(-1, 3)).reshape(free.shape)
    free[:, [joint for part in parts if part.name == "head" for joint in part.joints]] = False
    people, joints = np.nonzero(free)
    found: Array = np.stack([item.ids[people], joints], axis=1)
    return found
