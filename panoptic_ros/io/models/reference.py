"""The convolutional part of MoveNet's original graph in numpy, to check the converted net against.

Independent of the conversion: layouts, padding and resizing are those of TensorFlow.
"""

from __future__ import annotations

import numpy as np

from panoptic_ros.errors import BackendError, DataError
from panoptic_ros.io.models.movenet import CONVOLUTIONS, SCORES, find_heads
from panoptic_ros.io.models.tfjs import GraphModel, Operation

Array = np.ndarray
ELEMENTWISE = {"AddV2": np.add, "Sub": np.subtract, "Mul": np.multiply}
UNCHANGED = ("Cast", "ExpandDims", "Squeeze", "Unpack")  # of the one image, before it is normalised
TOLERANCE = 2e-3  # scores differ by 1e-4 at most, lengths in cells by 1e-3


def run_heads(graph: GraphModel, image: Array) -> dict[str, Array]:
    """The raw heads (1, C, h, w) for an image (H, W, 3) uint8 RGB, H and W multiples of 32.

    Raises:
        DataError: on an operation that MoveNet has not.
    """
    values = dict(graph.weights)
    for operation in graph.operations.values():
        if operation.kind == "Placeholder":
            values[operation.name] = image[None].astype(np.float32)
    heads = {}
    for head, reference in find_heads(graph).items():
        raw = _value(graph, reference, values)
        raw = 1.0 / (1.0 + np.exp(-np.maximum(raw, -80.0))) if head in SCORES else raw
        heads[head] = raw.transpose(0, 3, 1, 2)
    return heads


def verify(graph: GraphModel, outputs: dict[str, Array], image: Array) -> float:
    """Largest difference between a converted net's outputs for `image` and the original graph's.

    Raises:
        BackendError: if it is above `TOLERANCE`, naming the head.
    """
    worst = 0.0
    for head, expected in run_heads(graph, image).items():
        given = outputs[head]
        difference = np.inf if given.shape != expected.shape else float(np.abs(given - expected).max())
        if not difference <= TOLERANCE:
            raise BackendError(
                f"the converted net differs from the original by {difference:.2g} in head {head!r}; "
                "the installed versions of onnx and onnxruntime do not work together"
            )
        worst = max(worst, difference)
    return worst


def _value(graph: GraphModel, reference: str, values: dict[str, Array]) -> Array:
    if reference not in values:
        operation = graph.operations[reference]
        if operation.kind in CONVOLUTIONS:
            source = _value(graph, operation.inputs[0], values)
            values[reference] = _convolve(graph, operation, source)
        elif operation.kind in ELEMENTWISE:
            first, second = (_value(graph, name, values) for name in operation.inputs)
            values[reference] = ELEMENTWISE[operation.kind](first, second)
        elif operation.kind in UNCHANGED:
            values[reference] = _value(graph, operation.inputs[0], values)
        elif operation.kind == "ResizeBilinear":
            values[reference] = _double(_value(graph, operation.inputs[0], values))
        else:
            raise DataError(f"operation {operation.kind} ({reference}) is not one of MoveNet's")
    return values[reference]


def _convolve(graph: GraphModel, operation: Operation, source: Array) -> Array:
    """Convolution of (1, H, W, C) with a kernel (h, w, C, M), bias and activation."""
    kernel = graph.weights[operation.inputs[1]]
    strides = operation.attributes["strides"][1:3]
    windows = _windows(source, kernel.shape[:2], strides, operation.attributes["padding"])
    if "Depthwise" in operation.kind:
        apart: Array = np.einsum("nhwcij,ijcm->nhwcm", windows, kernel)
        result = apart.reshape(*windows.shape[:3], -1)
    else:
        result = np.tensordot(windows, kernel, ((4, 5, 3), (0, 1, 2)))
    for step in operation.attributes.get("fused_ops", ()):
        if step == "BiasAdd":
            result = result + graph.weights[operation.inputs[2]]
        elif step in ("Relu", "Relu6"):
            result = np.clip(result, 0.0, 6.0 if step == "Relu6" else None)
        else:
            raise DataError(f"activation {step} ({operation.name}) is not one of MoveNet's")
    return result.astype(np.float32)


def _windows(source: Array, kernel: tuple[int, int], strides: list[int], padding: str) -> Array:
    """All windows (1, h, w, C, kernel rows, kernel columns) that a convolution visits."""
    if padding == "SAME":
        pads = []
        for size, extent, stride in zip(source.shape[1:3], kernel, strides):
            total = max((-(-size // stride) - 1) * stride + extent - size, 0)
            pads.append((total // 2, total - total // 2))
        source = np.pad(source, ((0, 0), *pads, (0, 0)))
    windows = np.lib.stride_tricks.sliding_window_view(source, kernel, (1, 2))
    return windows[:, :: strides[0], :: strides[1]]


def _double(source: Array) -> Array:
    """(1, H, W, C) at twice the size, bilinear about pixel centres.

    MoveNet only doubles: each result is added to a map of twice the size.
    """
    for axis in (1, 2):
        extent = source.shape[axis]
        position = np.clip((np.arange(2 * extent) + 0.5) / 2.0 - 0.5, 0.0, None)
        low = np.floor(position).astype(int)
        shape = [1, 1, 1, 1]
        shape[axis] = 2 * extent
        weight = (position - low).astype(np.float32).reshape(shape)
        high = np.minimum(low + 1, extent - 1)
        source = source.take(low, axis) * (1.0 - weight) + source.take(high, axis) * weight
    return source
