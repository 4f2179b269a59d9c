"""Simulated captures without noise are exact, and with it as wrong as stated."""

from dataclasses import fields, replace

import numpy as np
import pytest

from panoptic_ros.geometry.rotations import from_quaternions, vectors_of
from panoptic_ros.io.body_models import read_body_model
from panoptic_ros.io.recorded_motions import read_clips
from panoptic_ros.simulation.bodies.cameras import JointNoise
from panoptic_ros.simulation.bodies.capture import FIRST_NS, BodyScene, simulate_body, sparse
from panoptic_ros.simulation.bodies.imus import ImuNoise, measure

MODEL, CLIPS = read_body_model(), read_clips()
CLEAN = JointNoise(white=0, correlated=0, bias=0, missing=0, missing_hidden=0, outliers=0, swaps=0)
EXACT = ImuNoise(**{field.name: 0.0 for field in fields(ImuNoise)})
SCENE = BodyScene(("02_05",), cameras=3, seconds=5.0, joints=CLEAN, imus=EXACT)


@pytest.fixture(scope="module")
def take():
    return simulate_body(SCENE, 4, MODEL, CLIPS)


def test_imus_tell_orientation_and_acceleration_exactly(take):
    motion, step = take.motion, 1 / 60
    for device in take.subject.devices:
        series = take.devices[device.name]
        turned = from_quaternions(series.quaternions)
        segment = motion.frames[:, device.segment]
        # one constant mounting, which without noise is the stated one
        apart = vectors_of(np.ascontiguousarray((segment @ device.mount).swapaxes(1, 2) @ turned))
        np.testing.assert_allclose(apart, 0, atol=1e-6)
        site = motion.places[:, device.segment] + segment @ device.position
        world = (turned @ series.forces[..., None])[..., 0] - [0, 0, 9.81]
        np.testing.assert_allclose(world[1:-1], np.diff(site, 2, axis=0) / step**2, atol=1e-5)


def test_a_body_at_rest_feels_gravity_upwards(take):
    still = replace(take.motion, places=take.motion.places[:1].repeat(90, 0), times=take.motion.times[:90])
    still = replace(still, frames=take.motion.frames[:1].repeat(90, 0))
    series = measure(np.random.default_rng(0), still, 0, np.zeros(3), np.eye(3), EXACT, FIRST_NS)
    world = (from_quaternions(series.quaternions) @ series.forces[..., None])[..., 0]
    np.testing.assert_allclose(world, np.tile([0, 0, 9.81], (90, 1)), atol=1e-9)
    np.testing.assert_allclose(series.rates, 0, atol=1e-9)


def test_the_same_seed_gives_the_same_capture(take):
    again = simulate_body(SCENE, 4, MODEL, CLIPS)
    np.testing.assert_array_equal(again.pixels, take.pixels)
    assert not np.array_equal(simulate_body(SCENE, 5, MODEL, CLIPS).pixels, take.pixels, equal_nan=True)


def test_noise_is_as_large_as_stated(take):
    noisy = simulate_body(replace(SCENE, joints=JointNoise()), 4, MODEL, CLIPS)
    apart = noisy.pixels - take.pixels
    spread = 1.4826 * np.nanmedian(np.abs(apart))
    assert 0.8 < spread / np.sqrt(4.5**2 + 7.5**2 + 6.0**2) < 1.5  # hidden ones are 2.5 times worse
    assert 0.03 < np.isnan(noisy.pixels[..., 0]).mean() < 0.3


def test_it_begins_in_a_t_facing_x_and_keeps_its_bones(take):
    frames = take.motion.frames[0]
    assert np.degrees(np.linalg.norm(vectors_of(np.ascontiguousarray(frames)), axis=-1)).max() < 20
    lengths = np.linalg.norm(take.motion.places[:, 8] - take.motion.places[:, 7], axis=-1)
    np.testing.assert_allclose(lengths, lengths[0])


def test_fewer_cameras_and_imus_are_a_part_of_the_same_capture(take):
    part = sparse(take, (0, 2), 6)
    assert len(part.rig) == 2 and len(part.devices) == 6
    np.testing.assert_array_equal(part.pixels[1], take.pixels[2])
