"""Which way is up in images, and what images say of the world's up."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.domain import Camera, Rig
from panoptic_ros.domain.upright import Z_UP, roll_of, up_of_images
from panoptic_ros.errors import CalibrationError
from panoptic_ros.geometry import Intrinsics, Rigid

LENS = Intrinsics(np.array([[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]]), np.zeros(5))


def turned(degrees: float) -> np.ndarray:
    """Rotation about the optical axis (3, 3) of a camera that is turned clockwise, as seen from behind."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def camera(name: str, heading: float, tilt: float = 20.0, clockwise: float = 0.0) -> Camera:
    """Make a camera that looks `tilt` degrees down, in a direction of the floor, in a world with z up."""
    a, b = np.radians([heading, tilt])
    forward = np.array([np.cos(a) * np.cos(b), np.sin(a) * np.cos(b), -np.sin(b)])
    right = np.array([np.sin(a), -np.cos(a), 0.0])
    pose = np.stack([right, np.cross(forward, right), forward])
    return Camera(name, (640, 480), LENS, Rigid(turned(clockwise) @ pose, np.array([0.0, 0.0, 5.0])))


def ring(clockwise: list[float], tilt: float = 20.0, spread: float = 90.0) -> list[Camera]:
    return [camera(f"cam{i}", spread * i, tilt, turn) for i, turn in enumerate(clockwise)]


def in_world(cameras: list[Camera], world: np.ndarray) -> list[Camera]:
    """Move cameras to a world whose coordinates are world (3, 3) @ ours."""
    return [
        replace(c, cam_from_world=Rigid(c.cam_from_world.rotation @ world.T, c.cam_from_world.translation))
        for c in cameras
    ]


@pytest.mark.parametrize("degrees", [0.0, 12.5, 45.0, 90.0, 133.0, 180.0, -90.0, -170.0])
def test_a_camera_turned_clockwise_has_images_that_are_turned_clockwise_to_be_upright(degrees):
    """The world turns counter-clockwise in the image of a camera that turns clockwise."""
    one = camera("a", 37.0, 25.0, degrees)
    top, bottom = one.project(np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]))[0]
    across, down = top - bottom  # of something upright, in the middle of the image
    seen = np.degrees(np.arctan2(across, -down))
    assert (seen + degrees + 180.0) % 360.0 == pytest.approx(180.0, abs=1e-6)
    assert roll_of(one, Z_UP) == pytest.approx(-degrees if degrees < 180.0 else 180.0, abs=1e-9)


def test_an_image_from_above_has_no_top():
    assert roll_of(camera("a", 10.0, 80.0, 120.0), Z_UP) == 0.0
    assert roll_of(camera("a", 10.0, 70.0, 120.0), Z_UP) == pytest.approx(-120.0)


@pytest.mark.parametrize("tilt", [0.0, 30.0, 60.0])
def test_quarter_turns_that_make_images_upright_tell_up(tilt):
    turns = [0.0, 90.0, 180.0, -90.0]
    quarters = [0, 1, 2, 3]  # a camera turned clockwise: its image is turned clockwise
    rng = np.random.default_rng(3)
    assert up_of_images(ring(turns, tilt), quarters) == Z_UP
    world, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    world *= np.linalg.det(world)
    found = up_of_images(in_world(ring(turns, tilt), world), quarters)
    np.testing.assert_allclose(found, world @ Z_UP, atol=1e-9)


def test_hands_are_not_exact():
    """Cameras a few degrees off a quarter turn tell up as exactly as they are held."""
    world = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # y down
    cameras = in_world(ring([4.0, -3.0, 95.0, 1.0]), world.T)
    found = up_of_images(cameras, [0, 0, 1, 0])
    assert np.degrees(np.arccos(found @ world.T @ Z_UP)) < 5.0


def test_images_that_disagree_tell_nothing():
    world = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    assert up_of_images(in_world(ring([0.0, 90.0, 0.0, 0.0]), world), [0, 0, 0, 0]) is None
    assert up_of_images(in_world(ring([90.0] * 4), world), [0] * 4) is None
    assert up_of_images(in_world(ring([0.0, 0.0], spread=0.0), world), [0, 0]) is None  # one axis alone


def test_a_rig_has_z_up_unless_it_says_something_else():
    cameras = tuple(ring([0.0, 0.0]))
    assert Rig(cameras).up == Z_UP and Rig(cameras, up=None).up is None
    assert Rig(cameras, up=(0.0, -2.0, 0.0)).up == (0.0, -1.0, 0.0)
    assert Rig(cameras, up=(0.0, -1.0, 0.0)).subset(["cam0"]).up == (0.0, -1.0, 0.0)
    for bad in ((0.0, 0.0, 0.0), (0.0, np.nan, 1.0), (np.inf, 0.0, 0.0), (1.0, 0.0)):
        with pytest.raises(CalibrationError, match="up direction"):
            Rig(cameras, up=bad)
