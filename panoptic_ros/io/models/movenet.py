"""Convert MoveNet's TensorFlow.js graph to ONNX with the raw heads of the network.

The original graph ends in a post-processing that returns six people and no score maps. The conversion removes
it and keeps the heads (Google, MoveNet model card; heads as in CenterNet, Zhou et al. 2019), which
`detection/decoders` decodes. The heads only need convolutions, sums and resizing by a factor of two.

The input of the ONNX graph is `image` uint8 (N, H, W, 3) RGB, with H and W multiples of 32. Its outputs lie
on a grid of stride 4: `center` (N, 1, h, w) and `heat` (N, 17, h, w) are scores in 0..1. `regress` and
`offset` (N, 34, h, w), and for MultiPose `box_scale` and `box_offset` (N, 2, h, w), are linear, in cells, y
before x.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from panoptic_ros.errors import DataError
from panoptic_ros.io.models.tfjs import GraphModel, Operation

Array = np.ndarray

HEAD_SCOPES = {
    "center": "center_0",
    "heat": "kpt_heatmap_0",
    "regress": "kpt_regress_0",
    "offset": "kpt_offset_0",
    "box_scale": "box_scale_0",
    "box_offset": "box_offset_0",
}
SCORES = ("center", "heat")  # these pass through a sigmoid, the others are linear
CONVOLUTIONS = ("_FusedConv2D", "FusedDepthwiseConv2dNative", "DepthwiseConv2dNative")
NORMALISED = "StatefulPartitionedCall/sub_1"  # the image after x / 127.5 - 1
OPSET, IR_VERSION = 17, 8  # versions of 2022, so that old runtimes can read the file


def find_heads(graph: GraphModel) -> dict[str, str]:
    """Return the operation of each raw head: the one linear convolution in its scope.

    Raises:
        DataError: if the graph is not a MoveNet.
    """
    heads = {}
    for head, scope in HEAD_SCOPES.items():
        found = [
            operation.name
            for operation in graph.operations.values()
            if f"/{scope}/" in operation.name
            and operation.kind == "_FusedConv2D"
            and operation.attributes.get("fused_ops") == ["BiasAdd"]
        ]
        if len(found) == 1:
            heads[head] = found[0]
    missing = {"center", "heat", "regress", "offset"} - set(heads)
    if missing or NORMALISED not in graph.operations:
        raise DataError(f"the graph is not a MoveNet: it lacks {', '.join(sorted(missing)) or NORMALISED}")
    return heads


def convert(graph: GraphModel) -> bytes:
    """Return the ONNX file; the same graph and onnx version give the same bytes.

    Raises:
        DataError: if the graph is not a MoveNet, or holds an unsupported operation.
    """
    import onnx  # only needed for the conversion

    heads = find_heads(graph)
    writer = _Writer(graph)
    outputs = []
    for head, operation in heads.items():
        writer.emit("Sigmoid" if head in SCORES else "Identity", [writer.tensor(operation)], head)
        channels = graph.weights[graph.operations[operation].inputs[1]].shape[3]
        outputs.append(
            onnx.helper.make_tensor_value_info(head, onnx.TensorProto.FLOAT, ["N", channels, "h", "w"])
        )
    image = onnx.helper.make_tensor_value_info("image", onnx.TensorProto.UINT8, ["N", "H", "W", 3])
    body = onnx.helper.make_graph(writer.nodes, "movenet_heads", [image], outputs, writer.constants)
    model = onnx.helper.make_model(
        body, opset_imports=[onnx.helper.make_opsetid("", OPSET)], ir_version=IR_VERSION
    )
    onnx.checker.check_model(model, full_check=True)
    serialised: bytes = model.SerializeToString(deterministic=True)
    return serialised


class _Writer:
    """Builder of the ONNX nodes and constants; it writes each original operation once."""

    def __init__(self, graph: GraphModel):
        import onnx

        self.onnx = onnx
        self.graph = graph
        self.nodes: list[Any] = []
        self.constants: list[Any] = []
        self.written: dict[str, str] = {}
        for name, value in (("zero", 0.0), ("six", 6.0), ("one", 1.0), ("half_range", 127.5)):
            self.constant(np.array(value, np.float32), name)
        self.constant(np.array([1, 1, 2, 2], np.float32), "twice")

    def constant(self, value: Array, name: str) -> str:
        self.constants.append(self.onnx.numpy_helper.from_array(np.ascontiguousarray(value), name))
        return name

    def emit(self, kind: str, inputs: list[str], output: str, **attributes: Any) -> str:
        self.nodes.append(self.onnx.helper.make_node(kind, inputs, [output], output, **attributes))
        return output

    def tensor(self, reference: str) -> str:
        """Return the name of the ONNX tensor of an operation's result; write the operation if needed."""
        if reference not in self.written:
            operation = self.graph.operations[reference]
            name = reference.removeprefix("StatefulPartitionedCall/")
            self.written[reference] = self._write(operation, name)
        return self.written[reference]

    def _write(self, operation: Operation, name: str) -> str:
        if operation.name == NORMALISED:
            return self._normalised_image()
        if operation.kind in CONVOLUTIONS:
            return self._convolution(operation, name)
        if operation.kind == "AddV2":
            return self.emit("Add", [self.tensor(source) for source in operation.inputs], name)
        if operation.kind == "ResizeBilinear":
            if not operation.attributes["half_pixel_centers"] or operation.attributes["align_corners"]:
                raise DataError(f"{operation.name} does not resize about pixel centres")
            return self.emit(
                "Resize",
                [self.tensor(operation.inputs[0]), "", "twice"],
                name,
                mode="linear",
                coordinate_transformation_mode="half_pixel",
            )
        raise DataError(f"operation {operation.kind} ({operation.name}) is not one of MoveNet's")

    def _normalised_image(self) -> str:
        # Not merged into the first convolution: its zero padding comes after the normalisation.
        self.emit("Cast", ["image"], "image_float", to=self.onnx.TensorProto.FLOAT)
        self.emit("Transpose", ["image_float"], "image_planes", perm=[0, 3, 1, 2])
        self.emit("Div", ["image_planes", "half_range"], "image_scaled")
        return self.emit("Sub", ["image_scaled", "one"], "image_normalised")

    def _convolution(self, operation: Operation, name: str) -> str:
        source = self.tensor(operation.inputs[0])
        kernel = self.graph.weights[operation.inputs[1]]
        height, width, channels, count = kernel.shape
        group = 1
        if "Depthwise" in operation.kind:  # (h, w, C, M) -> (C M, 1, h, w)
            group = channels
            kernel = kernel.transpose(2, 3, 0, 1).reshape(channels * count, 1, height, width)
        else:  # (h, w, in, out) -> (out, in, h, w)
            kernel = kernel.transpose(3, 2, 0, 1)
        inputs = [source, self.constant(kernel, f"{name}/kernel")]
        fused = operation.attributes.get("fused_ops", [])
        if "BiasAdd" in fused:
            inputs.append(self.constant(self.graph.weights[operation.inputs[2]], f"{name}/bias"))
        activation = [kind for kind in fused if kind != "BiasAdd"]
        strides = operation.attributes["strides"][1:3]
        linear = self.emit(
            "Conv",
            inputs,
            f"{name}/linear" if activation else name,
            group=group,
            strides=strides,
            kernel_shape=[height, width],
            pads=_same_padding(operation, (height, width), strides),
        )
        if activation == ["Relu6"]:
            return self.emit("Clip", [linear, "zero", "six"], name)
        if activation == ["Relu"]:
            return self.emit("Relu", [linear], name)
        if activation:
            raise DataError(f"activation {activation} ({operation.name}) is not one of MoveNet's")
        return linear


def _same_padding(operation: Operation, kernel: tuple[int, int], strides: list[int]) -> list[int]:
    """Return the padding (top, left, bottom, right) of TensorFlow's SAME.

    The odd row and column go to the bottom and right. Every size is a multiple of the stride (the image's of
    32), so the padding does not depend on the size.
    """
    if operation.attributes["padding"] != "SAME":
        return [0, 0, 0, 0]
    rows, columns = (max(size - stride, 0) for size, stride in zip(kernel, strides))
    return [rows // 2, columns // 2, rows - rows // 2, columns - columns // 2]
