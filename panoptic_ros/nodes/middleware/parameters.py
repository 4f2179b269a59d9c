"""Configuration of a stage as ROS parameters.

The parameters are declared with range and description, and then read back.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterValueException, ParameterAlreadyDeclaredException
from rclpy.node import Node
from rclpy.parameter import Parameter

from panoptic_ros.errors import ConfigError
from panoptic_ros.graph.flow import WINDOW, Flow, make_flow
from panoptic_ros.params import Config, Param, describe, load

_WIDE = 1e18  # replaces a missing bound: a ROS range needs both ends


def declare_flow(node: Node) -> Flow:
    """Declare `flow` (live or replay) and `replay_window`, and return the flow (see `graph.flow`)."""
    name = node.declare_parameter("flow", "live").value
    return make_flow(name, node.declare_parameter("replay_window", WINDOW).value)


def declare_config(node: Node, cls: type[Config], defaults: Mapping[str, Any], prefix: str = "") -> Config:
    """Declare all parameters of a configuration and return the configuration with their values.

    Args:
        defaults: of this node; they override the defaults of the configuration.
        prefix: of the parameter names.

    Raises:
        ConfigError: if a value from the command line or a file is out of range or of another type.
    """
    values: dict[str, Any] = {}
    for item in describe(cls):
        default = defaults.get(item.name, _default(item))
        try:
            value = node.declare_parameter(prefix + item.name, default, _descriptor(item)).value
        except (InvalidParameterValueException, ParameterAlreadyDeclaredException) as error:
            raise ConfigError(f"parameter {node.get_name()}.{prefix}{item.name}: {error}") from None
        values[item.name] = value if not isinstance(item.default, tuple) else list(value or [])
    return load(cls, values, where=f"{node.get_name()}.{prefix}")


def _default(item: Param) -> Any:
    """Return the default of a parameter; for an empty list, return the ROS parameter type instead.

    ROS would infer a byte array from an empty list.
    """
    if not isinstance(item.default, tuple):
        return item.default
    kinds = {
        tuple[str, ...]: Parameter.Type.STRING_ARRAY,
        tuple[float, ...]: Parameter.Type.DOUBLE_ARRAY,
        tuple[int, ...]: Parameter.Type.INTEGER_ARRAY,
    }
    return list(item.default) or kinds[item.type]


def _descriptor(item: Param) -> ParameterDescriptor:
    text = f"{item.told} [{item.unit}]" if item.unit else item.told
    descriptor = ParameterDescriptor(description=text, read_only=True)
    if item.choices:
        descriptor.additional_constraints = "one of " + ", ".join(item.choices)
    bounded = item.ge is not None or item.le is not None
    low = item.ge if item.ge is not None else -_WIDE
    high = item.le if item.le is not None else _WIDE
    if bounded and item.type is float:
        descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    if bounded and item.type is int:
        descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high), step=1)]
    return descriptor
