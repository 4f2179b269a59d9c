"""Generate config/<stage>.yaml and docs/parameters.md from the configuration classes."""

from __future__ import annotations

from collections.abc import Mapping

import yaml

from panoptic_ros.params import Config, Param, describe

HEADER = "Generated from the code by `panoptic config write`; a test checks that it is up to date."


def parameter_yaml(stage: str, cls: type[Config]) -> str:
    """Return the ROS parameter file of one stage with its defaults, each with a comment."""
    lines = [f"# Parameters of the stage {stage}, with their defaults.", f"# {HEADER}"]
    lines += [f"{stage}:", "  ros__parameters:"]
    for item in describe(cls):
        lines.append(f"    # {item.told}{_limits(item)}")
        if item.when:
            lines.append(f"    # Change it when {item.when}")
        lines.append(f"    {item.name}: {_yaml(item.default)}")
    if not describe(cls):
        lines[-1] += " {}"
    return "\n".join(lines) + "\n"


def parameter_page(classes: Mapping[str, type[Config]]) -> str:
    """Return the text of docs/parameters.md: the parameters that a lab changes, then one table per stage."""
    lines = [
        "# Parameters",
        "",
        HEADER,
        "",
        "Set them with `panoptic ... --set stage.name=value`, in a file for `--config` "
        "(`{stage: {name: value}}`, or like `config/<stage>.yaml`), or as ROS parameters of the stage's "
        "node. `--preset NAME` sets many at once (`config/presets`); the other values take precedence.",
        "",
        *_changed_by_labs(classes),
        "",
        "The rest is below, stage by stage. *Expert*: the default suits all captures that we know of; "
        "change it with figures in hand (`panoptic evaluate`, `panoptic study ablation`).",
        "",
    ]
    for stage, cls in classes.items():
        lines += [f"## {stage}", "", "| name | default | unit | range | description |"]
        lines.append("|---|---|---|---|---|")
        for item in describe(cls):
            cells = (f"`{item.name}`", f"`{_yaml(item.default)}`", item.unit, _range(item), item.told)
            lines.append("| " + " | ".join(cells) + " |")
        lines.append("")
    return "\n".join(lines)


def _changed_by_labs(classes: Mapping[str, type[Config]]) -> list[str]:
    """Return the table of all non-expert parameters, with the reasons to change them."""
    rows = [
        f"| `{stage}.{item.name}` | `{_yaml(item.default)}` | {item.when} |"
        for stage, cls in classes.items()
        for item in describe(cls)
        if not item.expert
    ]
    return [
        "## What to change, and when",
        "",
        f"The {len(rows)} parameters that a lab changes:",
        "",
        "| parameter | default | change it when |",
        "|---|---|---|",
        *rows,
    ]


def _yaml(value: object) -> str:
    plain = list(value) if isinstance(value, tuple) else value
    return yaml.safe_dump(plain, default_flow_style=True, width=10**6).strip().removesuffix("...").strip()


def _limits(item: Param) -> str:
    parts = [part for part in (f"unit {item.unit}" if item.unit else "", _range(item)) if part]
    return f" [{', '.join(parts)}]" if parts else ""


def _range(item: Param) -> str:
    if item.choices:
        return ", ".join(item.choices)
    if item.ge is not None and item.le is not None:
        return f"{item.ge:g} to {item.le:g}"
    if item.ge is not None:
        return f"at least {item.ge:g}"
    return f"at most {item.le:g}" if item.le is not None else ""
