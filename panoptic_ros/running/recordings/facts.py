"""Collects facts about a recorded graph: versions, parameters, model cards."""

from __future__ import annotations

import json
import platform
import time
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.parameter_client import AsyncParameterClient

import panoptic_ros
from panoptic_ros.errors import PanopticError
from panoptic_ros.io.files import read_bytes
from panoptic_ros.io.models import read_card

FORMAT = "panoptic-recording-1"
PACKAGES = ("ros-jazzy-rclpy", "rosbags", "numpy", "numba", "onnxruntime")
PATIENCE_S = 2.0  # s, timeout for the answers of all nodes


def recording_facts(node: Node, executor: Executor) -> dict[str, Any]:
    """Return facts about the graph as a JSON document.

    Its keys are format, host, begun, versions, nodes {name: {parameter: value}}, model_cards {name: text},
    and silent (nodes that did not answer).
    """
    asked = _ParameterRequests(node)
    deadline = time.monotonic() + PATIENCE_S
    while not asked.done and time.monotonic() < deadline:
        executor.spin_once(timeout_sec=0.05)
    asked.close()
    return {
        "format": FORMAT,
        "host": platform.node(),
        "begun": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "versions": _versions(),
        "nodes": asked.values,
        "model_cards": _cards(asked.values),
        "silent": sorted(asked.waiting),
    }


class _ParameterRequests:
    """Parameters of all other nodes. The nodes answer one after another."""

    def __init__(self, node: Node):
        self.values: dict[str, dict[str, Any]] = {}
        self.waiting: set[str] = set()
        self._clients: dict[str, Any] = {}
        for name, space in node.get_node_names_and_namespaces():
            whole = f"{space.rstrip('/')}/{name}"
            if whole == node.get_fully_qualified_name() or whole in self._clients:
                continue
            client = AsyncParameterClient(node, whole)
            if not client.services_are_ready():
                continue
            self._clients[whole] = client
            self.waiting.add(whole)
            client.list_parameters().add_done_callback(lambda future, whole=whole: self._named(whole, future))

    @property
    def done(self) -> bool:
        """Return whether all nodes have answered."""
        return not self.waiting

    def close(self) -> None:
        """Discard the clients, so that late answers have no effect."""
        self._clients.clear()

    def _named(self, whole: str, future: Any) -> None:
        names = list(future.result().result.names)
        if whole in self._clients:
            self._clients[whole].get_parameters(names).add_done_callback(
                lambda future: self._valued(whole, names, future)
            )

    def _valued(self, whole: str, names: list[str], future: Any) -> None:
        from rclpy.parameter import parameter_value_to_python

        values = future.result().values
        self.values[whole] = {n: _plain(parameter_value_to_python(v)) for n, v in zip(names, values)}
        self.waiting.discard(whole)


def _plain(value: Any) -> Any:
    """Return a parameter value as a JSON type."""
    return list(value) if hasattr(value, "__iter__") and not isinstance(value, str) else value


def _versions() -> dict[str, str]:
    found = {"panoptic_ros": panoptic_ros.__version__, "python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not a package of this installation"
    return found


def _cards(nodes: dict[str, dict[str, Any]]) -> dict[str, str]:
    """Return the text of the model card of every pose model that a node names."""
    named = {
        str(value)
        for values in nodes.values()
        for key, value in values.items()
        if key.split(".")[-1] == "model" and value
    }
    found = {}
    for name in sorted(named):
        try:
            found[name] = read_bytes(read_card(name).path).decode()
        except PanopticError as error:  # the model may exist only on another host
            found[name] = f"not here: {error}"
    return found


def as_text(document: dict[str, Any]) -> str:
    """Return the document as the text that the bag contains."""
    return json.dumps(document, indent=1, sort_keys=True, default=str)
