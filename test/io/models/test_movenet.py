"""The converted graph against the original one, in numpy."""

import json

import numpy as np
import pytest

from panoptic_ros.detection.backends.onnx import onnxruntime
from panoptic_ros.errors import BackendError, DataError
from panoptic_ros.io.models.fetch import run_heads, verify
from panoptic_ros.io.models.movenet import convert, find_heads
from panoptic_ros.io.models.tfjs import parse_graph


def outputs_of(data, image):
    session = onnxruntime.InferenceSession(data, providers=["CPUExecutionProvider"])
    names = [item.name for item in session.get_outputs()]
    return dict(zip(names, session.run(None, {"image": image})))


@pytest.mark.parametrize("size", [(32, 32), (64, 96), (160, 32)])
@pytest.mark.parametrize("boxes", [True, False])
def test_the_converted_net_gives_the_heads_of_the_original(tiny_net, size, boxes):
    graph = parse_graph(*tiny_net(seed=3).build(boxes).files())
    data = convert(graph)
    image = np.random.default_rng(1).integers(0, 256, (*size, 3), dtype=np.uint8)
    outputs = outputs_of(data, image[None])
    expected = run_heads(graph, image)
    assert set(outputs) == set(expected) and len(expected) == (6 if boxes else 4)
    for head, values in expected.items():
        assert outputs[head].shape == (1, values.shape[1], size[0] // 4, size[1] // 4)
        # the original holds 1 / 127.5 as float16, 2e-5 too small
        np.testing.assert_allclose(outputs[head], values, atol=5e-4, err_msg=head)
    assert outputs["heat"].min() >= 0 and outputs["heat"].max() <= 1
    assert verify(graph, outputs, image) < 5e-4


def test_a_batch_gives_what_single_images_give(tiny_files):
    data = convert(parse_graph(*tiny_files))
    images = np.random.default_rng(2).integers(0, 256, (2, 64, 32, 3), dtype=np.uint8)
    both = outputs_of(data, images)
    for index in (0, 1):
        one = outputs_of(data, images[index : index + 1])
        for head, values in one.items():
            np.testing.assert_allclose(both[head][index], values[0], atol=1e-5)


def test_the_same_graph_gives_the_same_bytes(tiny_files):
    assert convert(parse_graph(*tiny_files)) == convert(parse_graph(*tiny_files))


def test_a_shifted_or_wrong_net_is_found_out(tiny_files):
    graph = parse_graph(*tiny_files)
    image = np.random.default_rng(1).integers(0, 256, (64, 64, 3), dtype=np.uint8)
    good = outputs_of(convert(graph), image[None])
    shifted = {**good, "heat": np.roll(good["heat"], 1, axis=3)}
    with pytest.raises(BackendError, match="'heat'"):
        verify(graph, shifted, image)
    with pytest.raises(BackendError, match="'center'"):
        verify(graph, {**good, "center": good["center"][..., :-1]}, image)
    with pytest.raises(BackendError, match="'offset'"):
        verify(graph, {**good, "offset": good["offset"] * np.nan}, image)


def test_a_resize_about_corners_is_refused(tiny_files):
    topology, weights = tiny_files
    document = json.loads(topology)
    for node in document["modelTopology"]["node"]:
        if node["op"] == "ResizeBilinear":
            node["attr"]["align_corners"] = {"b": True}
    with pytest.raises(DataError, match="pixel centres"):
        convert(parse_graph(json.dumps(document).encode(), weights))


def test_another_graph_is_refused(tiny_files):
    topology, weights = tiny_files
    with pytest.raises(DataError, match="not a MoveNet: it lacks heat"):
        find_heads(parse_graph(topology.replace(b"kpt_heatmap_0", b"somethingelse"), weights))
    with pytest.raises(DataError, match="Softplus"):
        convert(parse_graph(topology.replace(b'"AddV2"', b'"Softplus"'), weights))


@pytest.mark.parametrize(
    "break_it",
    [
        lambda t, w: (b"{", w),
        lambda t, w: (b"[]", w),
        lambda t, w: (b"{}", w),
        lambda t, w: (t, w[:-2]),
        lambda t, w: (t, w + b"xx"),
        lambda t, w: (t.replace(b'"dtype": "float16"', b'"dtype": "uint8", "scale": 1'), w),
        lambda t, w: (t.replace(b'"U0FNRQ=="', b'"?"'), w),
    ],
)
def test_damaged_files_are_refused(tiny_files, break_it):
    with pytest.raises(DataError, match="no TensorFlow.js graph model"):
        parse_graph(*break_it(*tiny_files))
