"""What must not change the result of stage one: orders, the world's frame, pixel sizes, idle cameras."""

from dataclasses import replace
from functools import lru_cache

import invariances
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from panoptic_ros.geometry import Rigid
from panoptic_ros.simulation import NOISY, SKELETON, Ring, SimulatedScene, simulate
from panoptic_ros.simulation.drawn_maps import MapDrawing, with_drawn_maps

EXACT = 1e-6  # m
STILL = 1e-5  # m, steps that end an iteration; where the last one is depends on rounding
FRAMES = 3
DRAWING = MapDrawing((256, 144))

scenes = st.tuples(st.integers(2, 5), st.integers(2, 4), st.integers(0, 40))  # views, people, seed
with_maps = st.booleans()


@lru_cache(maxsize=64)
def capture(scene, maps):
    views, people, seed = scene
    activities = ("walk", "talk", "reach", "wave")[:people]
    take = simulate(
        SimulatedScene("test", activities, Ring(views), area=1.8, degradation=NOISY), seed, FRAMES
    )
    sets = list(take.detection_sets())
    return take.rig, [with_drawn_maps(item, DRAWING) for item in sets] if maps else sets


def solved(rig, sets, parameters=None):
    return invariances.solve(rig, SKELETON, sets, parameters or {})


@lru_cache(maxsize=64)
def reference(scene, maps):
    return solved(*capture(scene, maps))


@settings(max_examples=8)
@given(scene=scenes, maps=with_maps, order=st.randoms(use_true_random=False))
def test_order_of_cameras(scene, maps, order):
    rig, sets = capture(scene, maps)
    places = list(range(len(rig)))
    order.shuffle(places)
    found = solved(*invariances.other_order_of_cameras(rig, sets, places))
    assert invariances.largest_gap(reference(scene, maps), found) < EXACT


def test_order_of_cameras_whose_rays_may_be_paired_in_several_ways():
    found = solved(*invariances.other_order_of_cameras(*capture((5, 4, 8), True), [0, 1, 2, 4, 3]))
    assert invariances.largest_gap(reference((5, 4, 8), True), found) < EXACT


@pytest.mark.parametrize("places", [[0, 2, 3, 1], [1, 2, 3, 0]])
def test_order_of_cameras_that_all_disagree(places):
    """About some joints, so that wherever they are placed all views are outliers."""
    found = solved(*invariances.other_order_of_cameras(*capture((4, 4, 12), False), places))
    assert invariances.largest_gap(reference((4, 4, 12), False), found) < EXACT


def test_order_of_many_cameras():
    """So many observations that not all of them teach the noise."""
    scene = (20, 4, 0)
    found = solved(*invariances.other_order_of_cameras(*capture(scene, False), list(range(20))[::-1]))
    assert invariances.largest_gap(reference(scene, False), found) < EXACT


@settings(max_examples=8)
@given(scene=scenes, maps=with_maps, seed=st.integers(0, 99))
def test_order_of_people(scene, maps, seed):
    rig, sets = capture(scene, maps)
    found = solved(rig, invariances.other_order_of_people(sets, np.random.default_rng(seed)))
    assert invariances.largest_gap(reference(scene, maps), found) < EXACT


@settings(max_examples=8)
@given(scene=scenes, maps=with_maps, seed=st.integers(0, 99), shift=st.tuples(*[st.floats(-20.0, 20.0)] * 3))
@example(scene=(2, 4, 22), maps=True, seed=25, shift=(0.0, 0.0, 0.0))  # a person at the brink of being new
@example(scene=(3, 4, 12), maps=False, seed=2, shift=(-13.0, 0.0, 0.0))  # a joint: of being hidden
def test_frame_of_the_world(scene, maps, seed, shift):
    rig, sets = capture(scene, maps)
    new_from_old = Rigid(Rotation.random(random_state=seed).as_matrix(), np.array(shift))
    expected = solved(rig, sets)
    found = solved(invariances.moved_world(rig, new_from_old), sets)
    assert invariances.largest_gap(expected, found, new_from_old.inverse().apply) < STILL


@settings(max_examples=8)
@given(scene=scenes, maps=with_maps, factor=st.sampled_from([0.5, 2.0, 3.0]))
def test_size_of_pixels(scene, maps, factor):
    found = solved(*invariances.scaled_images(*capture(scene, maps), factor))
    assert invariances.largest_gap(reference(scene, maps), found) < EXACT


@settings(max_examples=8)
@given(scene=scenes, maps=with_maps, count=st.integers(1, 6))
def test_cameras_that_see_nothing(scene, maps, count):
    found = solved(*invariances.with_blind_cameras(*capture(scene, maps), count))
    assert invariances.largest_gap(reference(scene, maps), found) < EXACT


def test_an_absent_view_is_a_view_with_nobody():
    rig, sets = invariances.with_blind_cameras(*capture((4, 3, 1), False), 2)
    absent = [replace(item, views=item.views[:-2]) for item in sets]
    assert invariances.largest_gap(solved(rig, sets), solved(rig, absent)) < EXACT


@settings(max_examples=4)
@given(scene=scenes)
def test_votes_round_2d_joints_tell_nothing_new(scene):
    found = solved(*capture(scene, False), {"voting": {"without_maps": True}})
    for one, other in zip(reference(scene, False), found, strict=True):
        for name in ("positions", "covariances", "scores", "views", "states", "person_scores"):
            assert np.array_equal(getattr(one, name), getattr(other, name), equal_nan=True), name


def test_the_comparison_sees_differences():
    base = reference((5, 2, 0), False)
    assert invariances.largest_gap(base, base) == 0.0
    moved = invariances.largest_gap(base, base, lambda points: points + [0.0, 0.01, 0.0])
    assert moved == pytest.approx(0.01)
    fewer = [
        replace(
            item,
            sources=None,
            side_votes=None,
            **{
                name: getattr(item, name)[:1]
                for name in ("positions", "covariances", "scores", "views", "states", "person_scores")
            },
        )
        for item in base
    ]
    assert invariances.largest_gap(base, fewer) == np.inf
