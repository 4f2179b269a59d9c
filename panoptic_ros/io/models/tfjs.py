"""Read TensorFlow.js graph models: a JSON topology and one file of weights.

Format: github.com/tensorflow/tfjs, tfjs-converter (model.json with `modelTopology` and `weightsManifest`).
Strings in attributes are base64; float16 weights are plain casts.
"""

from __future__ import annotations

import base64
import binascii
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from panoptic_ros.errors import shown
from panoptic_ros.io.documents import parse_json
from panoptic_ros.io.loading import parsing

Array = np.ndarray


@dataclass(frozen=True)
class Operation:
    """One node of the graph; attributes are decoded to int, bool, str or a list of one of these types."""

    name: str
    kind: str
    inputs: tuple[str, ...]
    attributes: Mapping[str, Any]


@dataclass(frozen=True)
class GraphModel:
    """Operations by name, and the arrays of the constant operations by name."""

    operations: Mapping[str, Operation]
    weights: Mapping[str, Array]


def parse_graph(topology: bytes, weights: bytes) -> GraphModel:
    """Parse the graph from model.json and the bytes of its weights.

    Raises:
        DataError: if the two do not match, or are not such a model.
    """
    with parsing("no TensorFlow.js graph model"):
        document = parse_json(topology, "no TensorFlow.js graph model: model.json")
        nodes = document["modelTopology"]["node"]
        entries = [entry for group in document["weightsManifest"] for entry in group["weights"]]
        operations = {node["name"]: _operation(node) for node in nodes}
        return GraphModel(operations, _weights(entries, weights))


def _operation(node: Mapping[str, Any]) -> Operation:
    inputs = tuple(name.split(":")[0] for name in node.get("input", ()) if not name.startswith("^"))
    attributes = {key: _attribute(value) for key, value in node.get("attr", {}).items()}
    return Operation(node["name"], node["op"], inputs, attributes)


def _attribute(value: Mapping[str, Any]) -> Any:
    if "list" in value:
        items = value["list"]
        return [int(i) for i in items.get("i", ())] or [_text(s) for s in items.get("s", ())]
    if "s" in value:
        return _text(value["s"])
    if "i" in value:
        return int(value["i"])
    return value.get("b", value.get("type"))


def _text(encoded: str) -> str:
    try:
        return base64.b64decode(encoded, validate=True).decode()
    except (binascii.Error, UnicodeDecodeError) as error:
        raise ValueError(f"string {shown(encoded)} is not base64: {error}") from None


def _weights(entries: list[Mapping[str, Any]], data: bytes) -> dict[str, Array]:
    arrays: dict[str, Array] = {}
    start = 0
    for entry in entries:
        packing = entry.get("quantization", {})
        if "scale" in packing:
            raise ValueError(f"weight {entry['name']} is quantised, which is not supported")
        stored = np.dtype(packing.get("dtype", entry["dtype"])).newbyteorder("<")
        count = int(np.prod(entry["shape"], dtype=np.int64))
        raw = np.frombuffer(data, stored, count, start).reshape(entry["shape"])
        arrays[entry["name"]] = raw.astype(entry["dtype"])
        start += raw.nbytes
    if start != len(data):
        raise ValueError(f"the weights have {len(data)} bytes, but the manifest states {start}")
    return arrays
