"""Making stages from the table: classes by name, configurations from plain values."""

from __future__ import annotations

import importlib
from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any

from panoptic_ros.errors import ConfigError, nearest, shown
from panoptic_ros.graph.nodes import NODES, NodeSpec
from panoptic_ros.params import Config, from_text, load
from panoptic_ros.stage import Stage, StageContext

# What counts unless a parameter is given: that of another stage, or what a choice of another stage reads.
SHARED = {
    ("offsets", "delays_ms"): ("sync", "delays_ms"),
    ("clocks", "master_clock"): ("sync", "master_clock"),
}
NEEDED = {("assembly", "method", "dynamic_programming"): {"voting": {"parts": True, "without_maps": True}}}


def resolve(path: str) -> Any:
    """The object that "module:name" names."""
    module, _, name = path.partition(":")
    return getattr(importlib.import_module(module), name)


def config_class(stage: str) -> type[Config]:
    """The class of a stage's configuration.

    Raises:
        ConfigError: if there is no such stage.
    """
    if stage not in NODES:
        raise ConfigError(f"there is no stage {shown(stage)}; {nearest(stage, NODES)}")
    cls: type[Config] = resolve(NODES[stage].config)
    return cls


def configure(values: Mapping[str, Mapping[str, Any]]) -> dict[str, Config]:
    """Configurations of all stages from {stage: {parameter: value}}; the rest are defaults.

    Raises:
        ConfigError: on unknown stages or parameters and on bad values.
    """
    for stage in values:
        config_class(stage)
    given = with_shared(values)
    return {stage: load(config_class(stage), given.get(stage, {}), where=f"{stage}.") for stage in NODES}


def merged(*values: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """{stage: {parameter: value}} of all of these; where several give a parameter, the last counts."""
    together: dict[str, dict[str, Any]] = {}
    for given in values:
        for stage, own in given.items():
            together.setdefault(stage, {}).update(own)
    return together


def with_shared(values: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """{stage: {parameter: value}} with what stages must agree in given to all of them."""
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
    """("stage", "parameter", value) of a command line's "stage.parameter=value".

    Raises:
        ConfigError: if it is not of that form, or names what is not there.
    """
    name, equals, value = text.partition("=")
    stage, dot, parameter = name.strip().partition(".")
    if not (equals and dot and parameter):
        raise ConfigError(f"--set {shown(text)}: write stage.parameter=value, e.g. sync.window_s=0.01")
    return stage, parameter, from_text(config_class(stage), parameter, value.strip())


def switched_on(
    names: Collection[str], configs: Mapping[str, Config], table: Mapping[str, NodeSpec] = NODES
) -> tuple[str, ...]:
    """Those of the stages that no parameter switches off, in the order of the table."""
    return tuple(
        spec.name
        for spec in table.values()
        if spec.name in names and (not spec.switch or _is_on(configs, spec.name, spec.switch, True))
    )


def ports_in_use(configs: Mapping[str, Config], table: Mapping[str, NodeSpec] = NODES) -> tuple[str, ...]:
    """The ports that a parameter switches on, as "stage.topic"."""
    return tuple(
        f"{spec.name}.{port.topic}"
        for spec in table.values()
        if spec.name in configs
        for port in spec.inputs
        if port.switch and _is_on(configs, spec.name, port.switch, False)
    )


def _is_on(configs: Mapping[str, Config], stage: str, switch: str, unknown: bool) -> bool:
    """What a switch of a stage says; `unknown` where it is in a configuration that is not given."""
    other, _, name = switch.rpartition(".")
    config = configs.get(other or stage)
    return unknown if config is None else bool(getattr(config, name))


def rows_in_use(used: Collection[str], table: Mapping[str, NodeSpec] = NODES) -> dict[str, NodeSpec]:
    """The rows without ports that are not used. What comes back to all cameras merges their inputs.

    Args:
        used: see `ports_in_use`.
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
    """A stage of the table."""
    stage: Stage[Any, Any] = resolve(table[name].stage)(config, context)
    return stage
