import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoptic_ros.detection.card import CoordsCard, InputCard
from panoptic_ros.detection.preprocess import composed, crop, input_tensor, inverted, letterbox

SIZES = st.tuples(st.integers(40, 400), st.integers(40, 400))


def blob_picture(size, x, y, sigma):
    rows, columns = np.mgrid[: size[0], : size[1]]
    blob = 255.0 * np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / (2 * sigma**2))
    return np.repeat(np.rint(blob).astype(np.uint8)[..., None], 3, axis=2)


def centroid(picture):
    weights = picture[..., 0].astype(float)
    rows, columns = np.mgrid[: weights.shape[0], : weights.shape[1]]
    return np.array([(weights * columns).sum(), (weights * rows).sum()]) / weights.sum()


@pytest.mark.parametrize("fit", ["letterbox_topleft", "letterbox_center"])
@pytest.mark.parametrize(
    "size, net", [((300, 500), (160, 256)), ((500, 301), (256, 192)), ((90, 120), (192, 256))]
)
def test_letterbox_moves_a_blob_as_its_map_says(fit, size, net):
    place = np.array([0.4 * size[1], 0.55 * size[0]])
    card = InputCard(size=(256, 256), fit=fit, pad=0)
    picture, affine = letterbox(blob_picture(size, *place, 0.06 * min(size)), net, card)
    assert picture.shape == (*net, 3)
    np.testing.assert_allclose(centroid(picture), affine[:, :2] @ place + affine[:, 2], atol=0.02)


@settings(max_examples=40, deadline=None)
@given(SIZES, SIZES)
def test_letterbox_keeps_the_shape_and_pads_the_rest(size, net):
    card = InputCard(fit="letterbox_topleft", pad=7)
    picture, affine = letterbox(np.full((*size, 3), 200, np.uint8), net, card)
    filled = picture[..., 0] == 200
    rows, columns = int(filled.any(1).sum()), int(filled.any(0).sum())
    assert filled[:rows, :columns].all() and (picture[~filled] == 7).all()
    assert rows == net[0] or columns == net[1]
    # the borders of the image are the borders of the filled part
    low = affine[:, :2] @ (-0.5, -0.5) + affine[:, 2]
    high = affine[:, :2] @ (size[1] - 0.5, size[0] - 0.5) + affine[:, 2]
    np.testing.assert_allclose(low, -0.5, atol=1e-9)
    np.testing.assert_allclose(high, (columns - 0.5, rows - 0.5), atol=1e-9)


@pytest.mark.parametrize("udp", [False, True])
def test_crop_moves_a_blob_as_its_map_says(udp):
    card = InputCard(size=(128, 96), fit="crop", crop_padding=1.25, pad=0)
    place = np.array([150.3, 121.8])
    box = np.array([100.0, 60.0, 180.0, 200.0])
    picture, affine = crop(blob_picture((300, 300), *place, 5.0), box, card, CoordsCard(udp=udp))
    assert picture.shape == (128, 96, 3)
    np.testing.assert_allclose(centroid(picture), affine[:, :2] @ place + affine[:, 2], atol=0.05)


@pytest.mark.parametrize("udp, last", [(False, (96, 128)), (True, (95, 127))])
def test_crop_holds_the_enlarged_box_in_the_shape_of_the_input(udp, last):
    card = InputCard(size=(128, 96), fit="crop", crop_padding=1.5)
    box = np.array([10.0, 20.0, 20.0, 100.0])  # tall: its height, 80, decides
    _, affine = crop(np.zeros((50, 50, 3), np.uint8), box, card, CoordsCard(udp=udp))
    corners = inverted(affine) @ np.array([[0.0, last[0]], [0.0, last[1]], [1.0, 1.0]])
    np.testing.assert_allclose(corners[:, 0], (15.0 - 45.0, 60.0 - 60.0))
    np.testing.assert_allclose(corners[:, 1], (15.0 + 45.0, 60.0 + 60.0))


def test_the_tensor_has_the_order_type_and_range_that_the_card_says():
    image = np.zeros((32, 64, 3), np.uint8)
    image[..., 0], image[..., 1], image[..., 2] = 10, 20, 30  # B, G, R
    rgb = input_tensor([image, image], InputCard(mean=(1.0, 2.0, 3.0), std=(2.0, 4.0, 8.0)))
    assert rgb.shape == (2, 3, 32, 64) and rgb.dtype == np.float32 and rgb.flags.c_contiguous
    np.testing.assert_allclose(rgb[1, :, 0, 0], [(30 - 1) / 2, (20 - 2) / 4, (10 - 3) / 8])
    raw = input_tensor([image], InputCard(layout="NHWC", dtype="uint8", color="BGR"))
    assert raw.shape == (1, 32, 64, 3) and raw.dtype == np.uint8
    assert raw[0, 0, 0].tolist() == [10, 20, 30]


@settings(max_examples=50, deadline=None)
@given(
    st.lists(st.floats(0.1, 10), min_size=4, max_size=4),
    st.lists(st.floats(-50, 50), min_size=4, max_size=4),
)
def test_affine_maps_compose_and_invert(scales, shifts):
    first = np.array([[scales[0], 0, shifts[0]], [0, scales[1], shifts[1]]])
    second = np.array([[scales[2], 0, shifts[2]], [0, scales[3], shifts[3]]])
    point = np.array([3.0, -4.0])
    once = second[:, :2] @ (first[:, :2] @ point + first[:, 2]) + second[:, 2]
    both = composed(second, first)
    np.testing.assert_allclose(both[:, :2] @ point + both[:, 2], once, atol=1e-9)
    back = composed(inverted(both), both)
    np.testing.assert_allclose(back, [[1, 0, 0], [0, 1, 0]], atol=1e-9)


def test_shrinking_averages():
    stripes = np.zeros((128, 128, 3), np.uint8)
    stripes[:, ::2] = 200
    picture, _ = letterbox(stripes, (64, 64), InputCard())
    assert (picture == 100).all()
    assert cv2.resize(stripes, (64, 64), interpolation=cv2.INTER_NEAREST).max() == 200


def test_a_quick_shrink_is_bilinear_down_to_a_half_and_an_average_below():
    image = np.random.default_rng(5).integers(0, 255, (64, 96, 3), np.uint8)
    card = InputCard(fit="letterbox_topleft")
    for size, alike in (((48, 72), False), ((16, 24), True)):
        quick, own = letterbox(image, size, card, quick=True)
        slow, exact = letterbox(image, size, card)
        assert np.array_equal(own, exact)
        assert np.array_equal(quick, slow) == alike
