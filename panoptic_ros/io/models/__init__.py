"""Pose networks: their cards, the cache, fetching and converting, loading.

A model is named by a card (config/models/*.yaml, or the user's own file). `fetch` brings the
original files of the MoveNets, converts their TensorFlow.js graph to ONNX with the raw heads, checks
the result against the original graph in numpy, and keeps it in the cache; `load_detector` gives the
detection stage what it needs. Only `fetch` uses the network. Weights are never part of this package.
"""

from panoptic_ros.io.models.cards import DEFAULT_MODEL, CardFile, card_names, read_card
from panoptic_ros.io.models.fetch import fetch, is_cached
from panoptic_ros.io.models.load import load_detector

__all__ = ["DEFAULT_MODEL", "CardFile", "card_names", "fetch", "is_cached", "load_detector", "read_card"]
