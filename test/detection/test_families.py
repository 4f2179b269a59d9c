"""Every family's whole path: picture, letterbox or crop, session, decoder, pixels of the picture."""

import numpy as np
import pytest

from panoptic_ros.detection.model import DetectorModel

PLACES = np.array([[210.0, 90.0], [150.0, 160.0], [120.0, 60.0]])  # red, green, blue
SIZE = (240, 320)


def check(detections, places, tolerance, people=1):
    assert detections.points.shape == (people, 4, 2)
    for found, expected in zip(detections.points, np.reshape(places, (people, 3, 2))):
        np.testing.assert_allclose(found[:3], expected, atol=tolerance)
        np.testing.assert_allclose(found[3], found[:3].mean(0))
    assert (detections.scores > 0.3).all() and (detections.person_scores > 0.1).all()


def check_maps(detections, places, cells=1.0):
    """Each joint's map is largest where the joint is, within some cells."""
    maps = detections.maps
    dense = maps.dense(4)
    assert dense[3].max() == 0  # a mean of joints has no map
    for joint, place in enumerate(places):
        row, column = np.unravel_index(dense[joint].argmax(), dense[joint].shape)
        expected = maps.grid_from_image[:, :2] @ place + maps.grid_from_image[:, 2]
        assert np.abs(expected - (column, row)).max() <= cells
        assert dense[joint].max() > 100


def test_center_heads_and_the_pixel_conventions(blobs):
    cells = np.array([[30, 10], [20, 20], [12, 6]])  # of a 256 x 192 input
    scale = 0.8
    places = (4 * cells + 2.0) / scale - 0.5  # centres of cells, in pixels of the picture
    regress = (cells - cells[1])[:, ::-1].ravel()  # y before x, from the green joint's cell
    network = blobs.heads_network(regress)
    stage = blobs.stage(blobs.heads_card(), network, input_side=256, adapt_input=False)
    found = stage.step(blobs.frame(blobs.picture(SIZE, places))).outputs[0]
    check(found, places + (0.25 / scale, 0.0), 1e-6)  # the card moves joints by 0.25 net px
    check_maps(found, places, 0.1)
    # a cell's centre is sampled where the network's joint lies: (x_net / 4) - 0.5
    affine = found.maps.grid_from_image
    on_grid = affine[:, :2] @ found.points[0, 0] + affine[:, 2]
    np.testing.assert_allclose(on_grid, cells[0], atol=1e-6)


def test_center_heads_with_two_people_have_maps_each(blobs):
    cells = np.array([[[10, 10], [12, 20], [14, 30]], [[40, 10], [42, 20], [44, 30]]])
    places = (4 * cells + 2.0) - 0.5
    stage = blobs.stage(
        blobs.heads_card(), blobs.heads_network([-10, -2, 0, 0, 10, 2]), input_side=256, adapt_input=False
    )
    image = blobs.picture((192, 256), places[0], 4.0)
    image = np.maximum(image, blobs.picture((192, 256), places[1], 4.0, peak=200.0))
    found = stage.step(blobs.frame(image)).outputs[0]
    check(found, places + (0.25, 0.0), 1e-6, people=2)
    assert sorted(set(found.maps.persons.tolist())) == [0, 1]
    for person in (0, 1):
        mine = found.maps.persons == person
        middle = found.maps.corners[mine] + 0.5 * (found.maps.sizes[mine] - 1)
        order = np.argsort(found.maps.joints[mine])
        np.testing.assert_allclose(middle[order], cells[person], atol=0.6)


def soft_points(g, planes, origin):
    """Centres of mass (1, 3, 2) of the channels and their maxima (1, 3, 1)."""
    height, width = SIZE
    total = g("ReduceSum", planes, g.constant([2, 3], np.int64), keepdims=0)
    found = []
    for axis, count in ((3, width), (2, height)):
        shape = [1, 1, 1, count] if axis == 3 else [1, 1, count, 1]
        ramp = g.constant(np.reshape(np.arange(count) + origin, shape))
        moment = g("ReduceSum", g("Mul", planes, ramp), g.constant([2, 3], np.int64), keepdims=0)
        found.append(g("Unsqueeze", g("Div", moment, total), g.constant([2], np.int64)))
    best = g("Unsqueeze", g("ReduceMax", planes, axes=[2, 3], keepdims=0), g.constant([2], np.int64))
    return found[0], found[1], best


def points_network(blobs, variant, origin):
    g = blobs.Graph()
    x, y, best = soft_points(g, "input", origin)
    joints = g("Concat", x, y, best, axis=2)
    score = g("ReduceMin", best, axes=[1], keepdims=1)  # (1, 1, 1)
    if variant == "rtmo":
        g("Concat", g.constant([[[1, 2, 300, 200]]]), score, axis=2, name="dets")
        g("Unsqueeze", joints, g.constant([1], np.int64), name="keypoints")
        outputs = {"dets": [1, "M", 5], "keypoints": [1, "M", 3, 3]}
    else:
        flat = g("Reshape", joints, g.constant([1, 1, 9], np.int64))
        head = g.constant([[[1, 2, 300, 200]]])
        parts = [head, score] + ([g.constant([[[0]]])] if variant == "yolo_end_to_end" else []) + [flat]
        row = g("Concat", *parts, axis=2, name="people" if variant == "yolo_end_to_end" else "")
        outputs = {"people": [1, "M", 15]}
        if variant == "yolo":
            g("Transpose", row, perm=[0, 2, 1], name="people")
            outputs = {"people": [1, 14, "A"]}
    return g.model(blobs.image_input([1, 3, *SIZE]), outputs)


@pytest.mark.parametrize(
    "variant, origin, half",
    [("rtmo", "center", 0.0), ("yolo", "corner", 0.5), ("yolo_end_to_end", "corner", 0.5)],
)
@pytest.mark.parametrize("fit", ["letterbox_topleft", "letterbox_center"])
def test_points(blobs, variant, origin, half, fit):
    roles = {"boxes": "dets", "points": "keypoints"} if variant == "rtmo" else {"people": "people"}
    card = blobs.card(
        family="points",
        variant=variant,
        output=roles,
        coords={"origin": origin},
        input={"size": list(SIZE), "std": [255.0] * 3, "fit": fit, "pad": 0},
    )
    stage = blobs.stage(card, points_network(blobs, variant, half))
    image = blobs.picture((400, 400), PLACES + 40)  # another shape than the input: padded
    found = stage.step(blobs.frame(image)).outputs[0]
    check(found, PLACES + 40, 0.15)
    assert found.maps is None


def crop_input(blobs, size):
    return {"size": list(size), "fit": "crop", "pad": 0, "crop_padding": 1.25, "std": [255.0] * 3}


def heatmap_network(blobs, size, udp, batch):
    g = blobs.Graph()
    if udp:
        sizes = g.constant([batch if batch != "N" else 1, 3, size[0] // 4, size[1] // 4], np.int64)
        g(
            "Resize",
            "input",
            "",
            "",
            sizes,
            mode="linear",
            coordinate_transformation_mode="align_corners",
            name="output",
        )
    else:
        ends = g.constant([size[0], size[1]], np.int64)
        starts, axes, steps = (g.constant(v, np.int64) for v in ([0, 0], [2, 3], [4, 4]))
        g("Slice", "input", starts, ends, axes, steps, name="output")
    return g.model(blobs.image_input([batch, 3, *size]), {"output": [batch, 3, size[0] // 4, size[1] // 4]})


@pytest.mark.parametrize(
    "variant, udp, tolerance", [("dark", True, 0.4), ("dark", False, 0.4), ("quarter", False, 2.0)]
)
def test_heatmap_on_the_whole_image(blobs, variant, udp, tolerance):
    size = (192, 256)
    card = blobs.card(
        family="heatmap",
        variant=variant,
        output={"heat": "output"},
        coords={"udp": udp},
        input=crop_input(blobs, size),
    )
    stage = blobs.stage(card, heatmap_network(blobs, size, udp, 1))
    found = stage.step(blobs.frame(blobs.picture(SIZE, PLACES, 9.0))).outputs[0]
    check(found, PLACES, tolerance)
    check_maps(found, PLACES)


def simcc_network(blobs, size):
    g = blobs.Graph()
    for name, axis in (("simcc_x", 2), ("simcc_y", 3)):
        line = g("ReduceMax", "input", axes=[axis], keepdims=0)
        g(
            "Resize",
            line,
            "",
            g.constant([1, 1, 2]),
            mode="linear",
            coordinate_transformation_mode="asymmetric",
            name=name,
        )
    outputs = {"simcc_x": ["N", 3, 2 * size[1]], "simcc_y": ["N", 3, 2 * size[0]]}
    return g.model(blobs.image_input(["N", 3, *size]), outputs)


def finder(blobs, boxes):
    """A network of whole images that always finds the same boxes (N, 5), in px of a 320 x 320 input."""
    g = blobs.Graph()
    zero = g("Mul", g("ReduceMax", "input", axes=[1, 2, 3], keepdims=0), g.constant(0.0))
    g("Add", g.constant(np.asarray(boxes, np.float32)[None]), zero, name="boxes")
    card = blobs.card(
        family="boxes",
        variant="detections",
        joints=[],
        output={"boxes": "boxes"},
        input={"size": [320, 320], "fit": "letterbox_center"},
        coords={"origin": "corner"},
    )
    return DetectorModel(card, g.model(blobs.image_input([1, 3, 320, 320]), {"boxes": [1, "M", 5]}))


PAIR = np.array([[[60, 50], [80, 120], [70, 190]], [[250, 60], [230, 130], [240, 200]]], float)


def boxes_round(pair, shift):
    """Boxes in the finder's input: the picture sits `shift` below its top."""
    low, high = pair.min(axis=1) - 25 + 0.5, pair.max(axis=1) + 25 + 0.5
    low[:, 1] += shift
    high[:, 1] += shift
    return np.concatenate([low, high, [[0.9], [0.8]]], axis=1)


def test_simcc_on_crops_of_two_people(blobs):
    size = (256, 192)
    card = blobs.card(
        family="simcc", output={"x": "simcc_x", "y": "simcc_y"}, input=crop_input(blobs, size), stride=2
    )
    people = finder(blobs, boxes_round(PAIR, 40))
    stage = blobs.stage(card, simcc_network(blobs, size), people)
    found = stage.step(blobs.frame(blobs.picture(SIZE, PAIR))).outputs[0]
    check(found, PAIR, 0.6, people=2)
    assert set(found.maps.persons.tolist()) == {0, 1}
    first = found.maps.persons == 0
    assert (found.maps.corners[first, 0] < found.maps.grid_size[0] / 2).all()


@pytest.mark.parametrize("batch", [1, 2, 3])
def test_crops_go_through_networks_of_a_fixed_batch(blobs, batch):
    size = (128, 96)
    card = blobs.card(
        family="heatmap", variant="dark", output={"heat": "output"}, input=crop_input(blobs, size)
    )
    network = heatmap_network(blobs, size, False, batch)
    stage = blobs.stage(card, network, finder(blobs, boxes_round(PAIR, 40)))
    found = stage.step(blobs.frame(blobs.picture(SIZE, PAIR, 9.0))).outputs[0]
    check(found, PAIR, 0.8, people=2)


def test_single_heads_on_crops(blobs):
    taken = {"name": "image", "layout": "NHWC", "dtype": "uint8", "size": [256, 256], "fit": "crop", "pad": 0}
    roles = {role: role for role in ("center", "heat", "regress", "offset")}
    card = blobs.heads_card(family="single_heads", output=roles, input=taken)
    stage = blobs.stage(card, blobs.heads_network(), finder(blobs, boxes_round(PAIR, 40)))
    found = stage.step(blobs.frame(blobs.picture(SIZE, PAIR, 4.0))).outputs[0]
    check(found, PAIR, 2.5, people=2)  # the network's cells are 4 px of a crop of about the same scale
    check_maps(found, PAIR[0], 1e9)


def test_crops_without_people(blobs):
    size = (128, 96)
    card = blobs.card(
        family="heatmap", variant="dark", output={"heat": "output"}, input=crop_input(blobs, size)
    )
    nobody = finder(blobs, [[0, 0, 10, 10, 0.01]])
    stage = blobs.stage(card, heatmap_network(blobs, size, False, 1), nobody)
    found = stage.step(blobs.frame(blobs.picture(SIZE, PAIR))).outputs[0]
    assert found.points.shape == (0, 4, 2) and found.maps.data.size == 0


def test_activation_is_applied_to_scores(blobs):
    size = (64, 64)
    g = blobs.Graph()
    starts, ends, axes, steps = (g.constant(v, np.int64) for v in ([0, 0], [64, 64], [2, 3], [4, 4]))
    sliced = g("Slice", "input", starts, ends, axes, steps)
    g("Sub", g("Mul", sliced, g.constant(16.0)), g.constant(8.0), name="output")  # logits
    data = g.model(blobs.image_input([1, 3, *size]), {"output": [1, 3, 16, 16]})
    card = blobs.card(
        family="heatmap",
        variant="quarter",
        output={"heat": "output"},
        activation="sigmoid",
        input=crop_input(blobs, size),
    )
    image = blobs.picture(size, [[20, 20], [40, 24], [32, 48]], 5.0, peak=255.0)
    found = blobs.stage(card, data).step(blobs.frame(image)).outputs[0]
    np.testing.assert_allclose(found.scores[0, :3], 1 / (1 + np.exp(-8)), atol=1e-3)
