"""Pairs depend on stamps alone, and nobody waits for ever."""
import weakref

from hypothesis import given
from hypothesis import strategies as st

from panoptic_ros.graph.depth_pairing import DepthPairing

MS = 1_000_000


class Blob:
    def __init__(self, number):
        self.number = number


def run(order, images, depths, patience=None):
    """Feed in an order of "i" and "d", then end."""
    pairing, ready = DepthPairing(["a"], patience), []
    streams = {"i": iter(images), "d": iter(depths)}
    for kind in order:
        stamp = next(streams[kind], None)
        if stamp is not None:
            take = pairing.image if kind == "i" else pairing.depth
            ready += take("a", stamp, stamp)
    for kind, take in (("d", pairing.depth), ("i", pairing.image)):
        for stamp in streams[kind]:
            ready += take("a", stamp, stamp)
    return [(pair.image, pair.depth) for pair in ready + pairing.end("a")]


stamps = st.lists(st.integers(0, 400), unique=True, max_size=12).map(lambda v: sorted(t * MS for t in v))


@given(st.text("id", max_size=30), stamps, stamps)
def test_pairs_do_not_depend_on_the_order_of_the_topics(order, images, depths):
    expected = run("d" * 12, images, depths)
    assert run(order, images, depths) == expected
    assert [image for image, _ in expected] == images
    assert all(depth is None or abs(image - depth) <= 8 * MS for image, depth in expected)
    assert len({depth for _, depth in expected} - {None}) == sum(depth is not None for _, depth in expected)


@given(stamps, stamps)
def test_depth_maps_may_end_before_their_images_come(images, depths):
    pairing = DepthPairing(["a"], None)
    ready = [pair for stamp in depths for pair in pairing.depth("a", stamp, stamp)] + pairing.end("a")
    ready += [pair for stamp in images for pair in pairing.image("a", stamp, stamp)]
    assert [(pair.image, pair.depth) for pair in ready] == run("d" * 12, images, depths)


def test_an_image_waits_for_its_depth_but_not_for_one_that_was_left_out():
    pairing = DepthPairing(["a"], None)
    assert pairing.image("b", 0, "other") == [("b", 0, "other", None)]
    assert pairing.image("a", 100 * MS, 1) == []
    assert pairing.image("a", 133 * MS, 2) == []
    assert pairing.depth("a", 135 * MS, "x") == [("a", 100 * MS, 1, None), ("a", 133 * MS, 2, "x")]
    assert pairing.image("a", 166 * MS, 3) == []
    assert pairing.end("a") == [("a", 166 * MS, 3, None)]
    assert pairing.image("a", 200 * MS, 4) == [("a", 200 * MS, 4, None)]


def test_live_an_image_waits_no_longer_than_the_patience():
    pairing = DepthPairing(["a"], 100 * MS)
    assert pairing.image("a", 0, 1) == []
    assert pairing.image("a", 90 * MS, 2) == []
    assert pairing.image("a", 120 * MS, 3) == [("a", 0, 1, None)]


def test_live_depth_maps_of_failing_images_do_not_pile_up():
    pairing = DepthPairing(["a"], 100 * MS)
    kept = []
    for number in range(50):
        blob = Blob(number)
        kept.append(weakref.ref(blob))
        assert pairing.depth("a", number * 33 * MS, blob) == []
    del blob
    assert [ref().number for ref in kept if ref()] == [46, 47, 48, 49]
    assert pairing.image("a", 49 * 33 * MS, 1)[0].depth.number == 49


def test_live_depth_maps_of_before_a_clock_was_set_back_are_forgotten():
    pairing = DepthPairing(["a"], 100 * MS)
    assert pairing.depth("a", 900 * MS, "before") == []
    assert pairing.depth("a", 10 * MS, "after") == []
    assert pairing.image("a", 10 * MS, 1) == [("a", 10 * MS, 1, "after")]
