"""Camera arrangements: ring, corners of a room, and the dome of a studio with HD or VGA cameras."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from panoptic_ros.domain import Camera, Rig
from panoptic_ros.errors import UsageError
from panoptic_ros.geometry import Intrinsics, Rigid

Array = np.ndarray
HD = (1920, 1080)
VGA = (640, 480)
GOLDEN = np.pi * (3.0 - np.sqrt(5.0))  # rad; golden angle, which spreads points evenly
DOME_RADIUS = 2.745  # m; radius of the camera dome
DOME_CENTRE = np.array([0.0, 0.0, 1.40])  # m; centre of the camera dome
DOME_PANELS = ((8, -10.0), (7, 22.0), (5, 52.0))  # (panels per row, elevation in degrees)
DOME_PANEL_RADIUS = 0.55  # m; radius of a panel


class RigPlan(Protocol):
    """Plan of a camera arrangement."""

    def build(self, rng: np.random.Generator) -> Rig:
        """Return the cameras."""
        ...


@dataclass(frozen=True)
class Lens:
    """Parameters of the cameras' lenses.

    Args:
        image_size: Image size (width, height) px.
        focal: Range of focal lengths, px.
        distorted_every: Cameras with distortion: 0 = none, 1 = all, n = the last of every n.
    """

    image_size: tuple[int, int] = HD
    focal: tuple[float, float] = (1100.0, 1400.0)
    distorted_every: int = 3


@dataclass(frozen=True)
class Ring:
    """Cameras on a ring around the space, looking inwards.

    Args:
        cameras: Number of cameras.
        radius: Radius of the ring, m.
        heights: Range of camera heights, m.
        look_at: Height of the target point, m.
    """

    cameras: int
    radius: float = 4.2
    heights: tuple[float, float] = (2.0, 3.0)
    look_at: float = 0.95
    lens: Lens = Lens()

    def build(self, rng: np.random.Generator) -> Rig:
        """Return the cameras cam00, cam01, ..."""
        _check_count(self.cameras)
        cameras = []
        for i in range(self.cameras):
            angle = 2.0 * np.pi * (i + rng.uniform(-0.15, 0.15)) / self.cameras
            reach = self.radius * rng.uniform(0.95, 1.1)
            place = np.array([reach * np.cos(angle), reach * np.sin(angle), rng.uniform(*self.heights)])
            target = np.append(rng.normal(0.0, 0.15, 2), self.look_at + rng.uniform(-0.1, 0.1))
            cameras.append(_camera(rng, f"cam{i:02d}", place, target, self.lens, i))
        return Rig(tuple(cameras))


@dataclass(frozen=True)
class Corners:
    """Cameras in the corners of a room with size `room` (x, y) m; a fifth one is above a long wall."""

    cameras: int
    room: tuple[float, float] = (7.0, 6.0)
    lens: Lens = Lens(focal=(1100.0, 1250.0), distorted_every=2)

    def build(self, rng: np.random.Generator) -> Rig:
        """Return the cameras corner0, corner1, ..."""
        if not 1 <= self.cameras <= 5:
            raise UsageError(f"a room has places for 1 to 5 cameras, not {self.cameras}")
        x, y = 0.5 * self.room[0], 0.5 * self.room[1]
        places = [(x, y), (-x, y), (-x, -y), (x, -y), (0.0, y)]
        cameras = []
        for i, ground in enumerate(places[: self.cameras]):
            place = np.array([*ground, rng.uniform(2.3, 2.7)]) + rng.normal(0.0, 0.05, 3)
            target = np.append(rng.normal(0.0, 0.15, 2), 0.95)
            cameras.append(_camera(rng, f"corner{i}", place, target, self.lens, i))
        return Rig(tuple(cameras))


@dataclass(frozen=True)
class Dome:
    """Cameras on a spiral over the dome, at heights from 1 m to 3.6 m."""

    cameras: int = 31
    lens: Lens = Lens(distorted_every=1)

    def build(self, rng: np.random.Generator) -> Rig:
        """Return the cameras 00_00, 00_01, ..."""
        _check_count(self.cameras)
        cameras = []
        for i, height in enumerate(np.linspace(-0.15, 0.80, self.cameras)):
            target = np.append(rng.normal(0.0, 0.1, 2), rng.uniform(0.85, 1.05))
            place = _on_dome(i * GOLDEN, float(np.arcsin(height)))
            cameras.append(_camera(rng, f"00_{i:02d}", place, target, self.lens, i))
        return Rig(tuple(cameras))


@dataclass(frozen=True)
class PanelDome:
    """Cameras on the 20 panels of the dome, `per_panel` on each: 480 by default."""

    per_panel: int = 24
    lens: Lens = Lens(VGA, (440.0, 520.0), distorted_every=1)

    def build(self, rng: np.random.Generator) -> Rig:
        """Return the cameras 01_01 (panel, number) to 20_24."""
        _check_count(self.per_panel)
        number = np.arange(self.per_panel)
        spread = DOME_PANEL_RADIUS / DOME_RADIUS * np.sqrt((number + 0.5) / self.per_panel)  # rad
        panels = [
            (2.0 * np.pi * k / count, np.radians(elevation))
            for count, elevation in DOME_PANELS
            for k in range(count)
        ]
        cameras: list[Camera] = []
        for panel, (azimuth, elevation) in enumerate(panels, start=1):
            for i in number:
                up = elevation + spread[i] * np.sin(i * GOLDEN)
                turn = azimuth + spread[i] * np.cos(i * GOLDEN) / np.cos(elevation)
                target = np.append(rng.normal(0.0, 0.15, 2), rng.uniform(0.8, 1.2))
                name = f"{panel:02d}_{i + 1:02d}"
                cameras.append(_camera(rng, name, _on_dome(turn, up), target, self.lens, len(cameras)))
        return Rig(tuple(cameras))


def looking_at(place: Array, target: Array, roll: float = 0.0) -> Rigid:
    """Return cam_from_world of a camera at `place` (3,) m that faces `target`, rolled by `roll` rad."""
    forward = (target - place) / np.linalg.norm(target - place)
    level = np.cross(forward, [0.0, 0.0, 1.0])
    level /= np.linalg.norm(level)
    down = np.cross(forward, level)
    right = np.cos(roll) * level + np.sin(roll) * down
    rotation = np.stack([right, np.cross(forward, right), forward])
    return Rigid(rotation, -rotation @ place)


def _camera(
    rng: np.random.Generator, name: str, place: Array, target: Array, lens: Lens, index: int
) -> Camera:
    """Draw a camera with random focal length, principal point, roll and, depending on `lens`, distortion."""
    width, height = lens.image_size
    focal = rng.uniform(*lens.focal)
    cx, cy = 0.5 * (width - 1) + rng.normal(0.0, 8.0), 0.5 * (height - 1) + rng.normal(0.0, 8.0)
    matrix = [[focal, 0.0, cx], [0.0, focal * rng.uniform(0.998, 1.002), cy], [0.0, 0.0, 1.0]]
    radial = [rng.uniform(-0.14, -0.06), rng.uniform(0.02, 0.06)]
    distortion = np.array([*radial, *rng.normal(0.0, 3e-4, 2), 0.0])
    every = lens.distorted_every
    if not every or index % every != every - 1:
        distortion = np.zeros(5)
    pose = looking_at(place, target, roll=rng.normal(0.0, 0.02))
    return Camera(name, lens.image_size, Intrinsics(np.array(matrix), distortion), pose)


def _on_dome(azimuth: float, elevation: float) -> Array:
    horizontal = np.cos(elevation)
    direction = [horizontal * np.cos(azimuth), horizontal * np.sin(azimuth), np.sin(elevation)]
    return DOME_CENTRE + DOME_RADIUS * np.array(direction)


def _check_count(cameras: int) -> None:
    if cameras < 1:
        raise UsageError(f"a rig needs at least one camera, not {cameras}")


def farthest_first(rig: Rig, count: int) -> Rig:
    """Return `count` well-spread cameras of a rig, in the rig's order, as in Joo et al. 2017, 7.3.

    Each camera is the one farthest from those chosen before it, so smaller choices are subsets of larger
    ones. The first camera is the one farthest from the mean of all camera centres.

    Raises:
        UsageError: If the rig has fewer cameras.
    """
    if not 1 <= count <= len(rig):
        raise UsageError(f"{count} cameras of a rig of {len(rig)}")
    centres = np.array([camera.centre for camera in rig.cameras])
    taken: list[int] = []
    distances = np.linalg.norm(centres - centres.mean(axis=0), axis=1)
    for _ in range(count):
        taken.append(int(np.argmax(distances)))
        gaps = np.linalg.norm(centres - centres[taken[-1]], axis=1)
        distances = gaps if len(taken) == 1 else np.minimum(distances, gaps)
        distances[taken] = -1.0
    return Rig(tuple(rig.cameras[i] for i in sorted(taken)), rig.frame_id)
