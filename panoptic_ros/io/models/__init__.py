"""Pose networks: model cards, cache, download, conversion and loading.

A model card names a model (config/models/*.yaml, or the user's own file). `fetch` downloads the original
files of a MoveNet and converts the TensorFlow.js graph to ONNX with the raw heads. It compares the result
with a numpy implementation of the original graph, and stores it in the cache. `load_detector` returns the
input of the detection stage. Only `fetch` uses the network. Weights are never part of this package.
"""

from panoptic_ros.io.models.cards import DEFAULT_MODEL, CardFile, card_names, read_card
from panoptic_ros.io.models.fetch import fetch, is_cached
from panoptic_ros.io.models.load import load_detector

__all__ = ["DEFAULT_MODEL", "CardFile", "card_names", "fetch", "is_cached", "load_detector", "read_card"]
