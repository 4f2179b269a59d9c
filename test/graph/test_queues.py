"""What a node that falls behind works on next.

Live: images wait for their depth maps, and nobody waits for ever.
"""

import weakref

from hypothesis import given
from hypothesis import strategies as st

from panoptic_ros.graph.nodes import Port
from panoptic_ros.graph.queues import Companions, FifoQueue, NewestInstantQueue, QueuedMessage

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
        for bundle in waiting.put(QueuedMessage(topic, owner, stamp * MS, message))
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


def test_in_order_drops_the_oldest_of_the_same_topic():
    queue = FifoQueue(lambda key: 2)
    assert [queue.put("a", i, f"a{i}") for i in range(3)] == [0, 0, 1]
    assert queue.put("b", 0, "b0") == 0
    assert [queue.take() for _ in range(4)] == [["a1"], ["a2"], ["b0"], []]


def test_what_is_left_of_many_topics_stays_in_order():
    queue = FifoQueue(lambda key: 3)
    assert sum(queue.put(f"{i % 7}", i, i) for i in range(70)) == 49
    assert [queue.take()[0] for _ in range(21)] == list(range(49, 70))
    assert queue.take() == []
    queue.put("0", 0, "again")
    assert queue.take() == ["again"]


def test_samples_that_follow_one_another_are_taken_together_and_nothing_overtakes():
    queue = FifoQueue(in_runs=("imu left", "imu right"))
    for key, item in (("imu left", 1), ("imu right", 2), ("sets", 3), ("sets", 4), ("imu left", 5)):
        queue.put(key, 0, item)
    assert [queue.take() for _ in range(5)] == [[1, 2], [3], [4], [5], []]
    queue.put("imu left", 0, 6)
    assert queue.take() == [6]


def test_without_a_limit_nothing_is_dropped():
    queue = FifoQueue()
    assert sum(queue.put("a", i, i) for i in range(1000)) == 0
    assert [queue.take()[0] for _ in range(1000)] == list(range(1000))


def test_views_of_one_instant_are_taken_together_and_the_newest():
    queue = NewestInstantQueue(["a", "b"])
    for i in range(4):
        queue.put("a", 100 * i, ("a", i))
        if i < 3:
            queue.put("b", 100 * i + 3, ("b", i))
    assert queue.take() == [("a", 2), ("b", 2)]  # b has not reached instant 3 yet
    assert queue.take() == []
    assert queue.put("b", 303, ("b", 3)) == 4  # instants 0 and 1 of both were dropped
    assert queue.take() == [("a", 3), ("b", 3)]


def test_a_dead_camera_is_not_waited_for():
    queue = NewestInstantQueue(["a", "b"], patience_ns=250)
    queue.put("a", 0, "a0")
    queue.put("b", 0, "b0")
    assert queue.take() == ["a0", "b0"]
    queue.put("a", 100, "a1")
    assert queue.take() == []
    queue.put("a", 300, "a3")
    assert queue.take() == ["a3"]


def test_a_slow_camera_is_no_dead_one():
    queue, ms = NewestInstantQueue(["a", "b"]), 1_000_000
    for i in range(2):
        queue.put("a", 700 * i * ms, f"a{i}")
        queue.put("b", (700 * i + 50) * ms, f"b{i}")
    assert queue.take() == ["a1", "b1"]
    queue.put("a", 1400 * ms, "a2")  # b is 650 ms behind
    assert queue.take() == []
    queue.put("b", 1450 * ms, "b2")
    assert queue.take() == ["a2", "b2"]
    for i in range(3, 7):
        queue.put("a", 700 * i * ms, f"a{i}")
    assert queue.take() == ["a6"]


def test_depth_is_bounded():
    queue = NewestInstantQueue(["a", "b"], depth=3)
    assert sum(queue.put("a", i, i) for i in range(10)) == 7
