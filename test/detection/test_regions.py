"""Regions hold whom they are for, at a scale that suits them, and cost little."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from panoptic_ros.detection.regions import LEAST_SCALE, MARGIN, groups_of, person_boxes

SIZE = (640, 480)


def person(x, y, height, width=40.0):
    """Three joints: head, a hand, a foot."""
    return np.array([[x, y], [x + width, y + 0.4 * height], [x, y + height]])


def boxes_of(*people, size=SIZE, doubt=0.0):
    pixels = np.stack(people)
    return person_boxes(pixels, np.isfinite(pixels[..., 0]), np.full(len(people), doubt), size)


def regions_of(boxes, heights, who, tallest=220.0):
    return [group.region(SIZE, tallest, 32) for group in groups_of(boxes, heights, who)]


def test_a_box_holds_the_joints_and_a_margin():
    (box,), (height,), _ = boxes_of(person(200, 100, 200))
    assert height == 200.0
    assert box[0] == pytest.approx(200 - 200 * MARGIN) and box[2] == pytest.approx(240 + 200 * MARGIN)
    assert box[1] < 100 - 200 * MARGIN and box[3] == pytest.approx(300 + 200 * MARGIN)


def test_doubts_enlarge_the_box():
    (small,), _, _ = boxes_of(person(200, 100, 200))
    (large,), _, _ = boxes_of(person(200, 100, 200), doubt=10.0)
    np.testing.assert_allclose(large - small, [-15, -15, 15, 15])


def test_people_outside_of_the_image_have_none_and_those_at_the_border_a_part():
    boxes, heights, who = boxes_of(person(-300, 100, 200), person(-20, 100, 200))
    assert len(boxes) == len(heights) == 1 and who.tolist() == [1]
    assert boxes[0, 0] == 0.0 and heights[0] == 200.0


def test_joints_that_are_not_known_do_not_count():
    points = person(200, 100, 200)
    points[2] = np.nan
    (box,), (height,), _ = boxes_of(points)
    assert height == 80.0 and np.isfinite(box).all()


def test_people_who_touch_share_a_region_and_others_do_not():
    found = boxes_of(person(100, 100, 200), person(160, 120, 180), person(500, 100, 150))
    assert [(group.people, group.tallest) for group in groups_of(*found)] == [((0, 1), 200.0), ((2,), 150.0)]
    regions = regions_of(*found)
    assert len(regions) == 2
    assert regions[0].box[0] <= 100 and regions[0].box[2] >= 200
    assert regions[1].box[0] > 300


def test_a_chain_of_people_is_one_group():
    (group,) = groups_of(
        *boxes_of(person(100, 100, 200), person(400, 100, 200), person(150, 100, 200, 220.0))
    )
    assert sorted(group.people) == [0, 1, 2]


@pytest.mark.parametrize("height", [20, 60, 110])
def test_images_are_enlarged_for_those_who_ask_alone(height):
    (group,) = groups_of(*boxes_of(person(200, 100, height)))
    region, large = group.region(SIZE, 220.0, 32), group.region(SIZE, 220.0, 32, 2.0)
    scale = large.net_size[0] / (large.box[3] - large.box[1])
    assert 0.9 * LEAST_SCALE * 2.0 <= scale <= 2.05
    left, top, right, bottom = region.box
    assert right - left >= region.net_size[1] and bottom - top >= region.net_size[0]


@given(
    x=st.floats(-50, 600),
    y=st.floats(-50, 400),
    height=st.floats(20, 900),
    width=st.floats(5, 500),
    tallest=st.sampled_from([64.0, 160.0, 220.0]),
)
def test_a_region_holds_its_box_in_the_image_at_about_the_scale(x, y, height, width, tallest):
    boxes, heights, who = boxes_of(person(x, y, height, width))
    for box, tall, region in zip(boxes, heights, regions_of(boxes, heights, who, tallest)):
        left, top, right, bottom = region.box
        assert 0 <= left < right <= SIZE[0] and 0 <= top < bottom <= SIZE[1]
        assert left <= box[0] + 1 and top <= box[1] + 1 and right >= box[2] - 1 and bottom >= box[3] - 1
        rows, columns = region.net_size
        assert rows % 32 == columns % 32 == 0
        wanted = min(1.0, tallest / max(tall, 1.0))
        scale = min(columns / (right - left), rows / (bottom - top))
        assert scale * (box[2:] - box[:2]).min() >= 0.8 * LEAST_SCALE * wanted * (box[2:] - box[:2]).min() - 2
        assert scale <= 1.1 * wanted or min(rows, columns) <= 64
