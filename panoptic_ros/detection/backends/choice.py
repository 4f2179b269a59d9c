"""Choice of the inference library."""

from __future__ import annotations

from collections.abc import Sequence

from panoptic_ros.detection.backends.onnx import OnnxNetwork, runtime_providers
from panoptic_ros.detection.backends.openvino import NAME, OpenVinoNetwork, is_installed
from panoptic_ros.detection.card import ModelCard

Network = OnnxNetwork | OpenVinoNetwork


def open_network(
    card: ModelCard, onnx_bytes: bytes, providers: Sequence[str] = (), threads: int = 1
) -> Network:
    """Open a network with onnxruntime, or with OpenVINO's own package.

    The package is used if OpenVINO's provider comes first in `providers` and onnxruntime lacks it.

    Raises:
        BackendError: see `OnnxNetwork` and `OpenVinoNetwork`.
    """
    if list(providers[:1]) == [NAME] and NAME not in runtime_providers():
        return OpenVinoNetwork(card, onnx_bytes, threads)
    return OnnxNetwork(card, onnx_bytes, providers, threads)


def available_providers() -> list[str]:
    """List the execution providers of onnxruntime, and OpenVINO's if its package is installed."""
    found = runtime_providers()
    return [*found, NAME] if is_installed() and NAME not in found else found
