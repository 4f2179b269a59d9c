"""Which library runs a network."""

from __future__ import annotations

from collections.abc import Sequence

from panoptic_ros.detection.backends.onnx import OnnxNetwork, runtime_providers
from panoptic_ros.detection.backends.openvino import NAME, OpenVinoNetwork, is_installed
from panoptic_ros.detection.card import ModelCard

Network = OnnxNetwork | OpenVinoNetwork


def open_network(
    card: ModelCard, onnx_bytes: bytes, providers: Sequence[str] = (), threads: int = 1
) -> Network:
    """A network as onnxruntime runs it; as OpenVINO does where its provider comes first, but is not in
    onnxruntime.

    Raises:
        BackendError: as the network.
    """
    if list(providers[:1]) == [NAME] and NAME not in runtime_providers():
        return OpenVinoNetwork(card, onnx_bytes, threads)
    return OnnxNetwork(card, onnx_bytes, providers, threads)


def available_providers() -> list[str]:
    """Those of onnxruntime, and OpenVINO's where its package is installed."""
    found = runtime_providers()
    return [*found, NAME] if is_installed() and NAME not in found else found
