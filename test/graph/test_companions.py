"""Live: images wait for their depth maps, and nobody waits for ever."""

import weakref

from hypothesis import given
from hypothesis import strategies as st

from panoptic_ros.graph.companions import Companions, Item
from panoptic_ros.graph.nodes import Port

MS = 1_000_000
DEPTH = Port("depth", optional=True, ahead_ns=8 * MS + 1, patience_ns=100 * MS)


class Blob:
    def __init__(self, number):
        self.number = number


def companions():
    return Companions([DEPTH], {("depth", "a"), ("image", "a"), ("image", "b")})


def put(waiting, topic, stamp, message=None, owner="a"):
    return [
        tuple((item.topic, item.stamp_ns // MS) for item in bundle)
        for bundle in waiting.put(Item(topic, owner, stamp * MS, message))
    ]


def test_an_image_waits_for_its_depth_map_but_not_for_one_that_was_left_out():
    waiting = companions()
    assert put(waiting, "image", 0, owner="b") == [(("image", 0),)]
    assert put(waiting, "image", 100) == []
    assert put(waiting, "image", 133) == []
    assert put(waiting, "depth", 135) == [(("image", 100),), (("depth", 135), ("image", 133))]


def test_an_image_waits_no_longer_than_the_patience():
    waiting = companions()
    assert put(waiting, "image", 0) == []
    assert put(waiting, "image", 90) == []
    assert put(waiting, "image", 120) == [(("image", 0),)]


def test_depth_maps_of_failing_images_do_not_pile_up():
    waiting, kept = companions(), []
    for number in range(50):
        blob = Blob(number)
        kept.append(weakref.ref(blob))
        assert put(waiting, "depth", number * 33, blob) == []
    del blob
    assert [ref().number for ref in kept if ref()] == [46, 47, 48, 49]
    (bundle,) = put(waiting, "image", 49 * 33)
    assert bundle[-2:] == (("depth", 49 * 33), ("image", 49 * 33))


def test_depth_maps_of_before_a_clock_was_set_back_are_forgotten():
    waiting = companions()
    assert put(waiting, "depth", 900) == []
    assert put(waiting, "depth", 10) == []
    assert put(waiting, "image", 10) == [(("depth", 10), ("image", 10))]


stamps = st.lists(st.integers(0, 400), unique=True, max_size=12).map(sorted)


@given(st.text("id", max_size=30), stamps, stamps)
def test_all_images_come_in_order_each_at_most_once(order, images, depths):
    waiting, found = companions(), []
    streams = {"i": ("image", iter(images)), "d": ("depth", iter(depths))}
    for kind in (*order, *"i" * 12, *"d" * 12):
        topic, stream = streams[kind]
        stamp = next(stream, None)
        if stamp is not None:
            found += put(waiting, topic, stamp)
    shown = [stamp for bundle in found for topic, stamp in bundle if topic == "image"]
    assert shown == images[: len(shown)]
    for bundle in found:
        *maps, (_, stamp) = bundle
        assert all(topic == "depth" and time <= stamp + 8 for topic, time in maps)
