"""People whom image borders cut: 2D joints that a detector reports inside although the joint is outside."""

from dataclasses import replace

import numpy as np
import pytest
from fed_stages import FedAssembly
from hypothesis import given, settings
from hypothesis import strategies as st

from panoptic_ros.solving.joints import MISPLACED, artefact_cost

LOW = 0.3  # score of an artefact


def cropped(rig, sizes):
    """The rig with the upper left parts (width, height) px of some images, by camera numbers."""
    cameras = [
        replace(camera, image_size=sizes.get(k, camera.image_size)) for k, camera in enumerate(rig.cameras)
    ]
    return replace(rig, cameras=tuple(cameras))


def squeezed(rig, aside=0.0):
    """Return a change that moves joints beyond a border to 10 px inside of it, and `aside` px along it."""

    def change(i, points, scores):
        size = np.array(rig.cameras[i].image_size)
        beyond = points > size
        points[...] = np.where(beyond, size - 10.0, points + np.where(beyond[..., ::-1], aside, 0.0))
        scores[beyond.any(axis=-1)] = LOW

    return change


def offsets(scenes, rig, person, change, frames=8, noise=1.0, **settings):
    """Offsets (F, J, 3) m of one person in all but the first two instants."""
    stage, found = FedAssembly(scenes.context(rig), **settings), []
    for index in range(frames):
        item = scenes.proposals(rig, [person], index=index, noise=noise, change=change)
        (pose,) = stage.step(item).outputs
        assert len(pose.positions) == 1
        found.append(pose.positions[0] - person)
    return np.array(found[2:])


def cut_off(rig, camera, person):
    """Which joints (J,) lie outside of an image."""
    return ~rig.cameras[camera].sees(person)


@pytest.mark.parametrize("cut", [(0,), (0, 2), (0, 1, 2)])
def test_joints_below_an_image_are_not_pulled_into_it(scenes, cut):
    person = scenes.person(0.2, -0.1, turn=0.5)
    rig = cropped(scenes.ring(6), dict.fromkeys(cut, (1280, 540)))
    assert all(cut_off(rig, k, person).sum() == 4 for k in cut)  # knees and ankles
    found = offsets(scenes, rig, person, squeezed(rig, aside=15.0))
    assert np.linalg.norm(found, axis=-1).mean(axis=0).max() < 0.012


def test_joints_that_a_detector_puts_outside_of_the_image_are_observations(scenes):
    person = scenes.person(0.2, -0.1, turn=0.5)
    rig = cropped(scenes.ring(2), {0: (1280, 540)})
    found = offsets(scenes, rig, person, None, noise=0.0)
    assert found.shape[1:] == (19, 3) and np.abs(found).max() < 1e-6


@settings(max_examples=20)
@given(st.integers(0, 1000), st.integers(2, 6))
def test_who_is_inside_of_all_images_is_solved_the_same(scenes, seed, views):
    rng = np.random.default_rng(seed)
    people = [scenes.person(*rng.uniform(-0.5, 0.5, 2), rng.uniform(0, 6))]
    rig = scenes.ring(views + 1).subset(scenes.ring(views + 1).names[:views])
    found = []
    for borders in (True, False):
        stage = FedAssembly(scenes.context(rig), image_borders=borders)
        item = scenes.proposals(rig, people, noise=4.0, seed=seed)
        found.append(stage.step(item).outputs[0])
    assert np.array_equal(found[0].positions, found[1].positions, equal_nan=True)
    assert np.array_equal(found[0].covariances, found[1].covariances, equal_nan=True)


@given(st.floats(0.0, 0.3), st.floats(20.0, 1000.0), st.floats(0.05, 1.0))
def test_cost_of_an_artefact_is_its_likelihood(distance, precision, size):
    spread = max(MISPLACED * size, 1.0 / precision)

    def density(deviation):
        return np.exp(-0.5 * (distance / deviation) ** 2) / (2.0 * np.pi * deviation**2)

    peak = precision**2 / (2.0 * np.pi)
    cost = artefact_cost(distance**2, precision, size)
    assert np.exp(-0.5 * cost) == pytest.approx(density(spread) / peak, rel=1e-9)


def walk(scenes, rig, begin):
    """Return the number of skeletons in each of 40 instants of a walk from y = `begin` m to y = 3.6 m."""
    stage, shown = FedAssembly(scenes.context(rig)), []
    for index, y in enumerate(np.linspace(begin, 3.6, 40)):

        def change(i, points, scores):
            outside = ~rig.cameras[i].contains(points)
            points[outside], scores[outside] = np.nan, 0.0

        (pose,) = stage.step(
            scenes.proposals(rig, [scenes.person(0.0, y)], index=index, change=change)
        ).outputs
        shown.append(len(pose.positions))
    return shown


def test_who_is_followed_stays_where_a_new_person_is_a_bystander(scenes):
    rig = scenes.ring(5)
    edge = scenes.person(0.0, 3.6)
    assert sum(camera.sees(edge).mean() > 0.5 for camera in rig.cameras) == 2
    assert not any(walk(scenes, rig, 3.6))
    assert all(walk(scenes, rig, 0.0))
