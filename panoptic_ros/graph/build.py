"""Construction of stages and their configurations from the table of stages and plain values."""

from __future__ import annotations

import importlib
from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any

from panoptic_ros.errors import ConfigError, nearest, shown
from panoptic_ros.graph.nodes import NODES, NodeSpec
from panoptic_ros.params import Config, from_text, load
from panoptic_ros.stage import Stage, StageContext

# SHARED: a parameter that is not set gets the value of another stage's parameter. NEEDED: parameters that a
# choice of another stage requires.
SHARED = {
    ("offsets", "delays_ms"): ("sync", "delays_ms"),
    ("continuous", "delays_ms"): ("sync", "delays_ms"),
    ("continuous", "clocks"): ("sync", "clocks"),
    ("continuous", "capture_views"): ("assembly", "capture_views"),
    ("continuous", "memory"): ("tracking", "memory"),
    ("continuous", "recognition_time"): ("tracking", "recognition_time"),
    ("continuous", "subjects"): ("tracking", "subjects"),
    ("continuous", "bystanders"): ("tracking", "bystanders"),
    ("clocks", "master_clock"): ("sync", "master_clock"),
}
NEEDED = {("assembly", "method", "dynamic_programming"): {"voting": {"parts": True, "without_maps": True}}}


def resolve(path: str) -> Any:
    """Return the object that "module:name" names."""
    module, _, name = path.partition(":")
    return getattr(importlib.import_module(module), name)


def config_class(stage: str) -> type[Config]:
    """Return the configuration class of a stage.

    Raises:
        ConfigError: if there is no such stage.
    """
    if stage not in NODES:
        raise ConfigError(f"there is no stage {shown(stage)}; {nearest(stage, NODES)}")
    cls: type[Config] = resolve(NODES[stage].config)
    return cls


def configure(values: Mapping[str, Mapping[str, Any]]) -> dict[str, Config]:
    """Return the configurations of all stages from {stage: {parameter: value}}; other values are defaults.

    Raises:
        ConfigError: on unknown stages or parameters and on bad values.
    """
    for stage in values:
        config_class(stage)
    given = with_shared(values)
    return {stage: load(config_class(stage), given.get(stage, {}), where=f"{stage}.") for stage in NODES}


def merged(*values: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Return the merged {stage: {parameter: value}}; the last value of a parameter counts."""
    together: dict[str, dict[str, Any]] = {}
    for given in values:
        for stage, own in given.items():
            together.setdefault(stage, {}).update(own)
    return together


def with_shared(values: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Return {stage: {parameter: value}} with shared values copied to all stages that must agree on them."""
    given = {stage: dict(own) for stage, own in values.items()}
    for (stage, name), (other, source) in SHARED.items():
        if source in given.get(other, {}):
            given.setdefault(stage, {}).setdefault(name, given[other][source])
    for (other, source, choice), needed in NEEDED.items():
        if given.get(other, {}).get(source) == choice:
            for stage, own in needed.items():
                given[stage] = own | given.get(stage, {})
    return given


def parse_setting(text: str) -> tuple[str, str, Any]:
    """Return ("stage", "parameter", value) of a command line's "stage.parameter=value".

    Raises:
        ConfigError: if the text has another form, or the stage or parameter does not exist.
    """
    name, equals, value = text.partition("=")
    stage, dot, parameter = name.strip().partition(".")
    if not (equals and dot and parameter):
        raise ConfigError(f"--set {shown(text)}: write stage.parameter=value, e.g. sync.window_s=0.01")
    return stage, parameter, from_text(config_class(stage), parameter, value.strip())


def switched_on(
    names: Collection[str], configs: Mapping[str, Config], table: Mapping[str, NodeSpec] = NODES
) -> tuple[str, ...]:
    """Return the stages that no parameter switches off, in the order of the table."""
    return tuple(
        spec.name
        for spec in table.values()
        if spec.name in names and (not spec.switch or _is_on(configs, spec.name, spec.switch, True))
    )


def ports_in_use(configs: Mapping[str, Config], table: Mapping[str, NodeSpec] = NODES) -> tuple[str, ...]:
    """Return the ports that a parameter switches on, as "stage.topic"."""
    return tuple(
        f"{spec.name}.{port.topic}"
        for spec in table.values()
        if spec.name in configs
        for port in spec.inputs
        if port.switch and _is_on(configs, spec.name, port.switch, False)
    )


def _is_on(configs: Mapping[str, Config], stage: str, switch: str, unknown: bool) -> bool:
    """Return the value of a stage's switch; `unknown` if its configuration is not given."""
    other, _, name = switch.rpartition(".")
    config = configs.get(other or stage)
    return unknown if config is None else bool(getattr(config, name))


def rows_in_use(used: Collection[str], table: Mapping[str, NodeSpec] = NODES) -> dict[str, NodeSpec]:
    """Return the table without the ports that are not used.

    A feedback port in use applies to all cameras, so the inputs of all cameras of its stage are merged.

    Args:
        used: See `ports_in_use`.
    """
    return {spec.name: _row_in_use(spec, used) for spec in table.values()}


def _row_in_use(spec: NodeSpec, used: Collection[str]) -> NodeSpec:
    ports = tuple(port for port in spec.inputs if not port.switch or f"{spec.name}.{port.topic}" in used)
    guided = any(port.switch and port.feedback for port in ports)
    return (
        spec
        if ports == spec.inputs and not guided
        else replace(spec, inputs=ports, apart=spec.apart and not guided)
    )


def make_stage(
    name: str, config: Config, context: StageContext, table: Mapping[str, NodeSpec] = NODES
) -> Stage[Any, Any]:
    """Return a new stage of the table."""
    stage: Stage[Any, Any] = resolve(table[name].stage)(config, context)
    return stage
