"""A made network with MoveNet's behaviour: it finds people of some heights only."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoptic_ros.detection.input_size import InputSizeChooser, InputSizeResult, expected_quality, input_size

IMAGE = 1920


def look(side, heights, maps=True):
    """What the network says about people of these heights (px of the image) at a side."""
    heights = np.asarray(heights, float)
    net = heights * side / IMAGE
    found = (net > 40) & (net < 250)
    lost = int(maps and (~found & (net >= 250)).any()) * 12  # the maps outlive the person head
    return InputSizeResult(side, np.where(found, 0.6, 0.05)[found], heights[found], lost)


def run(chooser, people, frames=60):
    sides, found = [], []
    for _ in range(frames):
        answers = [look(side, people) for side in chooser.plan()]
        best = chooser.learn(answers, IMAGE)
        sides.append(answers[best].side)
        found.append(len(answers[best].scores))
    return sides, found


def chooser(**values):
    return InputSizeChooser(**{"start": 512, "least": 160, "most": 960, **values})


@pytest.mark.parametrize("height", [150, 250, 400, 700, 900, 1300, 1800])
def test_people_of_any_size_are_found_and_then_kept(height):
    sides, found = run(chooser(), [height])
    assert all(found[24:])
    assert len(set(sides[30:])) == 1  # settled
    net = height * sides[-1] / IMAGE
    assert 70 <= net <= 235


def test_people_that_suit_the_start_change_nothing():
    sides, _ = run(chooser(), [650, 500])
    assert set(sides) == {512}


def test_a_large_person_beside_a_small_one_is_missed_and_found_again():
    _, found = run(chooser(), [1100, 350])
    assert found[0] <= 2 and all(count == 2 for count in found[10:])


def test_an_empty_room_is_probed_ever_more_seldom():
    one = chooser()
    plans = []
    for _ in range(400):
        plan = one.plan()
        plans.append(len(plan))
        one.learn([look(side, []) for side in plan], IMAGE)
    probes = np.flatnonzero(np.array(plans) == 2)
    assert 5 < len(probes) < 40 and one.side == 512
    assert np.diff(probes).max() >= 64 and np.diff(probes)[0] <= 8


def test_a_fixed_side_stays():
    sides, _ = run(chooser(adaptive=False), [1800])
    assert set(sides) == {512}


def test_without_a_side_the_first_frame_tries_several():
    one = chooser(start=0)
    assert len(one.plan()) >= 3
    sides, found = run(one, [1300])
    assert found[0] == 1 and sides[0] <= 384


def test_limits_are_kept_and_sides_are_multiples():
    one = chooser(least=256, most=600, multiple=64)
    seen = set()
    for height in (100, 1900, 300, 1900, 60):
        seen |= set(run(one, [height], 30)[0])
    assert all(256 <= side <= 600 for side in seen)
    assert all(side % 64 == 0 or side in (256, 600) for side in seen)


@settings(max_examples=30, deadline=None)
@given(st.lists(st.lists(st.floats(50, 1900), max_size=4), min_size=1, max_size=40))
def test_the_same_people_give_the_same_sides(frames):
    def sides():
        one = chooser()
        taken = []
        for people in frames:
            taken.append(one.plan())
            one.learn([look(side, people) for side in taken[-1]], IMAGE)
        return taken

    assert sides() == sides()


def test_quality_prefers_the_middle():
    sides = np.arange(160, 961, 32)
    best = sides[expected_quality(np.array([800 / IMAGE]), sides).argmax()]
    assert 150 <= 800 * best / IMAGE <= 210


@settings(max_examples=60, deadline=None)
@given(st.integers(160, 1280), st.integers(64, 4000), st.integers(64, 4000))
def test_the_input_holds_the_image_and_is_no_larger_than_needed(side, width, height):
    rows, columns = input_size(side, (width, height), 32)
    assert rows % 32 == columns % 32 == 0
    scale = side / max(width, height)
    for extent, size in ((height, rows), (width, columns)):
        assert size >= 32 and size + 0.5 >= extent * scale
        assert size == 32 or size - 32 < extent * scale + 0.5
