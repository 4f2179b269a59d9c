"""What depth sensors measure round people, and which of them can be believed.

Sensors stand anywhere and measure when they like, on the master time line; nothing is registered. A map
counts for instants within 40 ms of it. A sensor whose maps do not meet the people that cameras see, as of a
wrong scale or pose, is left out until they do.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from panoptic_ros.domain import Camera, DepthFrame, Rig, TrackedPoseSet
from panoptic_ros.domain.parts import Part
from panoptic_ros.errors import DataError
from panoptic_ros.patches.depth_buffer import SensedMap
from panoptic_ros.patches.lifting import Capsules
from panoptic_ros.stage import Notice

Array = np.ndarray
KEPT = 4  # newest maps of a sensor
NEAR_NS = 40_000_000  # between a map and the instant that it counts for
SILENT_NS = 1_000_000_000  # after which a sensor that gave maps is told to be silent
WINDOW = 2  # px to each side, of which the nearest surface counts
FREE = 0.02  # m in front of it
KNOWN = 9  # px of the 25 of a window that must be known
MEETS = 0.1  # m by which a surface may miss a capsule
FEWEST = 6  # points on people that tell of a map
MEMORY = 0.2  # of the newest map, in the share that meets people
LIES, TRUE = 0.25, 0.4  # shares below and above which a sensor is left out and believed


class DepthMaps:
    """The newest maps of all sensors."""

    def __init__(self, rig: Rig):
        self.cameras = {sensor.name: sensor.camera for sensor in rig.depth_sensors}
        self._planes = {name: _plane(camera) for name, camera in self.cameras.items()}
        self.forget()

    def forget(self) -> None:
        """Forget all maps, and who can be believed."""
        self.maps: dict[str, deque[DepthFrame]] = {}
        self.shares: dict[str, float] = {}  # of points on people that maps meet
        self.believed: dict[str, bool] = {}
        self.meets: dict[str, bool] = {}  # whether the newest map does, by itself
        self.told: set[str] = set()  # sensors that are told to be silent

    def take(self, item: DepthFrame) -> None:
        """One more map; older ones than the newest are left out.

        Raises:
            DataError: if it is of a sensor that the rig does not have, or of another size.
        """
        camera = self.cameras.get(item.camera)
        if camera is None:
            raise DataError(f"a map of depth sensor {item.camera}, which is not in the rig")
        if item.image_size != camera.image_size:
            found, size = ("{} x {}".format(*size) for size in (item.image_size, camera.image_size))
            raise DataError(f"a map of depth sensor {item.camera} has {found} px, the rig says {size}")
        own = self.maps.setdefault(item.camera, deque(maxlen=KEPT))
        if not own or item.stamp_ns > own[-1].stamp_ns:
            own.append(item)

    def near(self, stamp_ns: int) -> list[tuple[int, SensedMap]]:
        """The map of each believed sensor that is nearest to an instant, and its stamp."""
        return [
            found
            for name, found in self.nearest(stamp_ns)
            if self.believed.get(name, False) and self.meets.get(name, False)
        ]

    def nearest(self, stamp_ns: int) -> list[tuple[str, tuple[int, SensedMap]]]:
        """The same of all sensors, with their names."""
        found = []
        for name in sorted(self.maps):
            item = min(self.maps[name], key=lambda item: abs(item.stamp_ns - stamp_ns))
            if abs(item.stamp_ns - stamp_ns) <= NEAR_NS:
                found.append((name, (item.stamp_ns, self._sensed(item))))
        return found

    def _sensed(self, item: DepthFrame) -> SensedMap:
        depth = np.ascontiguousarray(item.depth)
        depth.flags.writeable = False
        return SensedMap(self.cameras[item.camera], self._planes[item.camera], depth)

    def judge(self, stamp_ns: int, capsules: Capsules) -> tuple[Notice, ...]:
        """Hold the maps of an instant against the people there; tells, once, who is left out or silent."""
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
            text = f"depth sensor {name}: {now:.0%} of the people that cameras see are where it measures them"
            if self.believed[name]:
                notices.append(Notice("patches.depth_back", "info", f"{text}; it is used again", whose))
            else:
                hint = "; it is left out: check its unit, pose and clock"
                notices.append(Notice("patches.depth_lies", "warning", text + hint, whose))
        for name, own in self.maps.items():
            silent, whose = stamp_ns - own[-1].stamp_ns > SILENT_NS, {"device": name}
            if silent and name not in self.told:
                text = f"depth sensor {name} gives no maps: patches go on without it"
                notices.append(Notice("patches.depth_silent", "warning", text, whose))
            elif not silent and name in self.told:
                text = f"depth sensor {name} gives maps again"
                notices.append(Notice("patches.depth_again", "info", text, whose))
            (self.told.add if silent else self.told.discard)(name)
        return tuple(notices)


def _plane(camera: Camera) -> Array:
    """Its pixels on the plane at distance 1: (h, w, 2)."""
    width, height = camera.image_size
    rows, columns = np.indices((height, width))
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 2).astype(float)
    plane: Array = camera.intrinsics.undistort(pixels).reshape(height, width, 2)
    return plane


def meeting(sensed: SensedMap, capsules: Capsules) -> float:
    """Share of places on people (K) whose surface a map has where they are; NaN: too few to tell."""
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


def in_front(sensed: SensedMap, points: Array) -> Array:
    """Which of some points (N, 3) m are in free space: in front of all that a map has round them (N,).

    Holes are unknown, never free (Joo et al. 2017, 6.2, test the one pixel; its noise and that of joints on
    thin limbs then make one true joint in twenty an outlier).
    """
    depths, known = _window(sensed, points)
    places = sensed.camera.cam_from_world.apply(points)[:, 2]
    free: Array = known & (places > 0.0) & (places < depths - FREE)
    return free


def _window(sensed: SensedMap, points: Array) -> tuple[Array, Array]:
    """Smallest depth (N,) m in the window round each point (N, 3) m, and whether enough of it is known."""
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
    """Ids and joints (F, 2) of a set that some believed sensor sees through: they are outliers
    (Joo et al. 2017, 6.2).

    A map of another instant is held against where joints were then, between two sets. Joints of the face lie
    on the surface and tell nothing.

    Args:
        last: those of the set before, which tell no motion.
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
