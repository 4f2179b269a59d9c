"""Tiny networks made of ONNX operators that see coloured blobs, and pictures of such blobs.

Joint 0, 1 and 2 is the red, green and blue blob; the networks are told nothing but their input, so
that a wrong order of colours, a wrong normalisation or a shifted picture changes what is found.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from panoptic_ros.detection.card import ModelCard, card_from_mapping
from panoptic_ros.detection.config import DetectionConfig
from panoptic_ros.detection.model import DetectorModel
from panoptic_ros.detection.stage import DetectionStage
from panoptic_ros.domain import JointMap, SkeletonModel, ViewFrame
from panoptic_ros.stage import StageContext

JOINTS = ["red", "green", "blue"]
SKELETON = SkeletonModel("blobs", ("red", "green", "blue", "middle"), 0, ((0, 1), (1, 2), (1, 3)), 0)
JOINT_MAP = JointMap(3, ((0,), (1,), (2,), (0, 1, 2)))


class Graph:
    """Collects ONNX nodes; every operator gives the name of its output."""

    def __init__(self) -> None:
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def constant(self, value: Any, dtype: Any = np.float32) -> str:
        name = f"c{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(np.asarray(value, dtype), name))
        return name

    def __call__(self, kind: str, *inputs: str, name: str = "", **attributes: Any) -> str:
        output = name or f"t{len(self.nodes)}"
        self.nodes.append(helper.make_node(kind, list(inputs), [output], **attributes))
        return output

    def model(self, source: Any, outputs: dict[str, list[Any]]) -> bytes:
        """The file; shapes of outputs may hold names for sizes that are open."""
        infos = [helper.make_tensor_value_info(n, TensorProto.FLOAT, s) for n, s in outputs.items()]
        body = helper.make_graph(self.nodes, "blobs", [source], infos, self.constants)
        made = helper.make_model(body, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
        onnx.checker.check_model(made)
        return made.SerializeToString()


def image_input(shape: list[Any], dtype: str = "float32", name: str = "input") -> Any:
    kind = TensorProto.UINT8 if dtype == "uint8" else TensorProto.FLOAT
    return helper.make_tensor_value_info(name, kind, shape)


@dataclass
class Blobs:
    """What tests need; handed out by the fixture `blobs`."""

    Graph = Graph
    image_input = staticmethod(image_input)
    skeleton = SKELETON
    joint_map = JOINT_MAP

    @staticmethod
    def picture(size: tuple[int, int], places: Any, sigma: float = 6.0, peak: float = 250.0) -> np.ndarray:
        """A black BGR picture (height, width) with blobs (P, 3, 2) at pixels, centre of the first = 0."""
        rows, columns = np.mgrid[: size[0], : size[1]]
        image = np.zeros((*size, 3))
        for person in np.asarray(places, float).reshape(-1, 3, 2):
            for joint, (x, y) in enumerate(person):
                blob = np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / (2 * sigma**2))
                image[..., 2 - joint] = np.maximum(image[..., 2 - joint], peak * blob)
        return np.rint(image).astype(np.uint8)

    @staticmethod
    def card(**values: Any) -> ModelCard:
        return card_from_mapping({"name": "blobs", "joints": JOINTS, **values})

    @staticmethod
    def stage(card: ModelCard, data: bytes, finder: DetectorModel | None = None, **config: Any):
        extras = {"detector": DetectorModel(card, data, finder), "joint_map": JOINT_MAP}
        return DetectionStage(DetectionConfig(**config), StageContext(None, SKELETON, extras))

    @staticmethod
    def frame(image: np.ndarray, number: int = 0, camera: str = "left") -> ViewFrame:
        return ViewFrame(camera, 1000 * number, number, image)

    @staticmethod
    def heads_card(**values: Any) -> ModelCard:
        """A card for `heads_network`."""
        return Blobs.card(
            **{
                "family": "center_heads",
                "input": {"name": "image", "layout": "NHWC", "dtype": "uint8", "size": "dynamic"},
                "output": {r: r for r in ("center", "heat", "regress", "offset", "box_scale", "box_offset")},
                "coords": {"origin": "corner", "shift_px": [0.25, 0.0]},
                **values,
            }
        )

    @staticmethod
    def heads_network(regress: Any = (0.0,) * 6, box: float = 1000.0) -> bytes:
        """Centre heads: heat = the picture in cells, the centre is the green joint's."""
        g = Graph()
        planes = g("Transpose", g("Cast", "image", to=TensorProto.FLOAT), perm=[0, 3, 1, 2])
        scaled = g("Div", planes, g.constant(255.0))
        pooled = g("AveragePool", scaled, kernel_shape=[4, 4], strides=[4, 4])
        g("Identity", pooled, name="heat")
        axes = g.constant([1], np.int64)
        green = g("Slice", pooled, g.constant([1], np.int64), g.constant([2], np.int64), axes)
        g("Identity", green, name="center")
        zero = g("Mul", green, g.constant(0.0))
        g("Add", zero, g.constant(np.reshape(regress, (1, 6, 1, 1))), name="regress")
        g("Add", zero, g.constant(np.full((1, 6, 1, 1), 0.5)), name="offset")
        g("Add", zero, g.constant(np.full((1, 2, 1, 1), box)), name="box_scale")
        g("Add", zero, g.constant(np.zeros((1, 2, 1, 1))), name="box_offset")
        cells = ["h", "w"]
        return g.model(
            image_input(["N", "H", "W", 3], "uint8", "image"),
            {
                "center": ["N", 1, *cells],
                "heat": ["N", 3, *cells],
                "regress": ["N", 6, *cells],
                "offset": ["N", 6, *cells],
                "box_scale": ["N", 2, *cells],
                "box_offset": ["N", 2, *cells],
            },
        )
