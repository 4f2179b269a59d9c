"""A little net that is built like MoveNet, as a TensorFlow.js model, and a stand-in for npm."""

from __future__ import annotations

import base64
import hashlib
import io
import json
import os
import stat
import tarfile
from pathlib import Path

import numpy as np
import pytest
import yaml

JOINTS = 3
ROOT = "StatefulPartitionedCall/"


class TinyNet:
    """Collects nodes and weights of a TensorFlow.js graph model."""

    def __init__(self, seed: int = 0) -> None:
        self.rng = np.random.default_rng(seed)
        self.nodes: list[dict] = [{"name": "input", "op": "Placeholder"}]
        self.weights: list[tuple[str, np.ndarray]] = []

    def constant(self, name: str, value: np.ndarray) -> str:
        self.weights.append((name, np.asarray(value)))
        self.nodes.append({"name": name, "op": "Const"})
        return name

    def node(self, name: str, op: str, inputs: list[str], **attributes: object) -> str:
        attr = {}
        for key, value in attributes.items():
            if isinstance(value, bool):
                attr[key] = {"b": value}
            elif isinstance(value, str):
                attr[key] = {"s": base64.b64encode(value.encode()).decode()}
            elif isinstance(value[0], int):
                attr[key] = {"list": {"i": [str(v) for v in value]}}
            else:
                attr[key] = {"list": {"s": [base64.b64encode(v.encode()).decode() for v in value]}}
        self.nodes.append({"name": name, "op": op, "input": inputs, "attr": attr})
        return name

    def conv(self, name: str, source: str, shape: tuple, stride: int = 1, fused: tuple = ("BiasAdd",)) -> str:
        depthwise = "depthwise" in name
        op = "_FusedConv2D"
        if depthwise:
            op = "FusedDepthwiseConv2dNative" if fused else "DepthwiseConv2dNative"
        inputs = [source, self.constant(name + "/w", self.rng.normal(0, 0.4, shape))]
        if fused:
            count = shape[2] * shape[3] if depthwise else shape[3]
            inputs.append(self.constant(name + "/b", self.rng.normal(0, 0.3, count)))
        attributes = {"fused_ops": list(fused)} if fused else {}
        return self.node(name, op, inputs, strides=[1, stride, stride, 1], padding="SAME", **attributes)

    def build(self, boxes: bool = True) -> TinyNet:
        cast = self.node(ROOT + "Cast", "Cast", ["input"])
        scale = self.constant(ROOT + "scale", np.float32(1 / 127.5))
        scaled = self.node(ROOT + "mul", "Mul", [cast, scale])
        image = self.node(ROOT + "sub_1", "Sub", [scaled, self.constant(ROOT + "sub_1/y", np.float32(1))])
        relu6, relu = ("BiasAdd", "Relu6"), ("BiasAdd", "Relu")
        half = self.conv(ROOT + "a", image, (3, 3, 3, 4), 2, relu6)
        quarter = self.conv(ROOT + "b_depthwise", half, (3, 3, 4, 2), 2, relu6)
        eighth = self.conv(ROOT + "c", quarter, (3, 3, 8, 8), 2, relu)
        size = self.constant(ROOT + "size", np.array([1, 1], np.int32))
        about_centres = {"half_pixel_centers": True, "align_corners": False}
        up = self.node(ROOT + "up", "ResizeBilinear", [eighth, size], **about_centres)
        features = self.node(ROOT + "add", "AddV2", [up, quarter])
        plain = self.conv(ROOT + "d_depthwise", features, (3, 3, 8, 1), 1, ())
        widths = {"center_0": 1, "kpt_heatmap_0": JOINTS}
        widths |= {"kpt_regress_0": 2 * JOINTS, "kpt_offset_0": 2 * JOINTS}
        if boxes:
            widths |= {"box_scale_0": 2, "box_offset_0": 2}
        for scope, width in widths.items():
            hidden = self.conv(f"{ROOT}{scope}/re_lu/Relu", plain, (1, 1, 8, 6), 1, relu)
            self.conv(f"{ROOT}{scope}/conv2d/BiasAdd", hidden, (1, 1, 6, width))
        return self

    def files(self) -> tuple[bytes, bytes]:
        entries, data = [], b""
        for name, value in self.weights:
            if value.dtype == np.int32:
                entries.append({"name": name, "shape": list(value.shape), "dtype": "int32"})
                data += value.astype("<i4").tobytes()
            else:
                packing = {"dtype": "float16", "original_dtype": "float32"}
                entries.append(
                    {"name": name, "shape": list(value.shape), "dtype": "float32", "quantization": packing}
                )
                data += value.astype("<f2").tobytes()
        topology = {
            "modelTopology": {"node": self.nodes},
            "weightsManifest": [{"paths": ["tiny.bin"], "weights": entries}],
        }
        return json.dumps(topology).encode(), data


@pytest.fixture
def tiny_files() -> tuple[bytes, bytes]:
    return TinyNet().build().files()


@pytest.fixture
def tiny_net() -> type[TinyNet]:
    return TinyNet


def digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


@pytest.fixture
def tiny_card(tmp_path: Path, tiny_files: tuple[bytes, bytes]) -> Path:
    """A card file of the little net, to be fetched from the package `tiny@1`."""
    topology, weights = tiny_files
    card = {
        "name": "tiny",
        "family": "center_heads",
        "fetch": {
            "package": "tiny@1",
            "topology": {"member": "package/models/tiny.json", "sha256": digest(topology)},
            "weights": {"member": "package/models/tiny.bin", "sha256": digest(weights)},
            "mean_outputs": {},
        },
        "input": {"name": "image", "layout": "NHWC", "dtype": "uint8", "size": "dynamic"},
        "output": {r: r for r in ("center", "heat", "regress", "offset", "box_scale", "box_offset")},
        "joints": ["nose", "left_eye", "right_eye"],
    }
    path = tmp_path / "cards" / "tiny.yaml"
    path.parent.mkdir()
    path.write_text(yaml.safe_dump(card))
    return path


class FakeNpm:
    """An executable `npm` on the path that hands out an archive, or fails as it is told."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.calls = folder / "calls.txt"
        folder.mkdir()
        self.write("node", "exit 0")
        self.fails("npm error code E404\nnpm error 404 Not Found")

    def write(self, name: str, body: str) -> None:
        path = self.folder / name
        path.write_text(f"#!/bin/sh\n{body}\n")
        path.chmod(path.stat().st_mode | stat.S_IXUSR)

    def fails(self, text: str) -> None:
        (self.folder / "error.txt").write_text(text)
        self.write("npm", f'echo "$@" >> {self.calls}\n/bin/cat {self.folder / "error.txt"} >&2\nexit 1')

    def gives(self, members: dict[str, bytes], cut: int | None = None) -> None:
        archive = self.folder / "package.archive"
        buffer = io.BytesIO()
        with tarfile.open(fileobj=buffer, mode="w:gz") as tar:
            for name, data in members.items():
                entry = tarfile.TarInfo(name)
                entry.size = len(data)
                tar.addfile(entry, io.BytesIO(data))
        archive.write_bytes(buffer.getvalue()[:cut])
        self.write("npm", f'echo "$@" >> {self.calls}\n/bin/cp {archive} ./tiny-1.tgz')

    @property
    def count(self) -> int:
        return len(self.calls.read_text().splitlines()) if self.calls.exists() else 0


@pytest.fixture
def npm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tiny_files: tuple[bytes, bytes]) -> FakeNpm:
    fake = FakeNpm(tmp_path / "bin")
    topology, weights = tiny_files
    fake.gives(
        {"package/readme": b"hello", "package/models/tiny.json": topology, "package/models/tiny.bin": weights}
    )
    monkeypatch.setenv("PATH", f"{fake.folder}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("PANOPTIC_CACHE", str(tmp_path / "cache"))
    return fake
