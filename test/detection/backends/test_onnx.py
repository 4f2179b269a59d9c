import numpy as np
import pytest

from panoptic_ros.detection.backends.onnx import OnnxNetwork, runtime_providers
from panoptic_ros.errors import BackendError


def simcc(blobs, **values):
    return blobs.card(
        **{
            "family": "simcc",
            "output": {"x": "simcc_x", "y": "simcc_y"},
            "input": {"size": [64, 32], "fit": "crop"},
            **values,
        }
    )


def network(blobs, x=64, y=128, joints=3, dtype="float32", name="input", shape=("N", 3, 64, 32)):
    g = blobs.Graph()
    g("Identity", g.constant(np.zeros((1, joints, x))), name="simcc_x")
    g("Identity", g.constant(np.ones((1, joints, y))), name="simcc_y")
    outputs = {"simcc_x": ["N", joints, x], "simcc_y": ["N", joints, y]}
    return g.model(blobs.image_input(list(shape), dtype, name), outputs)


def test_outputs_come_by_role(blobs):
    outputs = OnnxNetwork(simcc(blobs), network(blobs)).run(np.zeros((1, 3, 64, 32), np.float32))
    assert set(outputs) == {"x", "y"} and outputs["y"].shape == (1, 3, 128) and outputs["y"].all()


@pytest.mark.parametrize(
    "made, words",
    [
        ({"x": 62}, ["simcc_x", "62", "64"]),
        ({"joints": 5}, ["simcc_x", "5", "3"]),
        ({"dtype": "uint8"}, ["input", "uint8", "float32"]),
        ({"name": "picture"}, ["picture", "input"]),
        ({"shape": ("N", 3, 64, 48)}, ["input", "48", "32"]),
        ({"shape": ("N", 64, 32, 3)}, ["input", "64"]),
        ({"shape": (3, 64, 32)}, ["input"]),
    ],
)
def test_a_tensor_that_differs_from_the_card_is_named(blobs, made, words):
    with pytest.raises(BackendError) as caught:
        OnnxNetwork(simcc(blobs), network(blobs, **made))
    for word in ["blobs", *words]:
        assert word in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_output_that_is_not_there_is_named(blobs):
    card = simcc(blobs, output={"x": "simcc_x", "y": "wrong"})
    with pytest.raises(BackendError, match=r"no output 'wrong' \(y\); it has simcc_x, simcc_y"):
        OnnxNetwork(card, network(blobs))


@pytest.mark.parametrize("data", [b"", b"no network", b"\x00" * 1000])
def test_other_files_are_refused(blobs, data):
    with pytest.raises(BackendError, match="not an ONNX file that can be run"):
        OnnxNetwork(simcc(blobs), data)


def test_a_truncated_file_is_refused(blobs):
    with pytest.raises(BackendError, match="not an ONNX file that can be run"):
        OnnxNetwork(simcc(blobs), network(blobs)[:-60])


def test_providers_that_are_not_there_are_refused_with_those_that_are(blobs):
    with pytest.raises(BackendError, match="'NoSuchProvider'.*CPUExecutionProvider"):
        OnnxNetwork(simcc(blobs), network(blobs), ["NoSuchProvider"])
    available = runtime_providers()
    assert OnnxNetwork(simcc(blobs), network(blobs), available[-1:], threads=2).batch_limit is None


def test_a_wrong_input_at_run_time_is_one_line(blobs):
    made = OnnxNetwork(simcc(blobs), network(blobs))
    with pytest.raises(BackendError, match="blobs failed") as caught:
        made.run(np.zeros((1, 4, 64, 32), np.float32))
    assert "\n" not in str(caught.value)


def test_a_fixed_batch_is_known(blobs):
    assert OnnxNetwork(simcc(blobs), network(blobs, shape=(4, 3, 64, 32))).batch_limit == 4
