"""Options that several verbs share: parameters and the skeleton."""
from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from panoptic_ros.domain import Rig
from panoptic_ros.errors import ConfigError
from panoptic_ros.graph.build import configure, parse_setting
from panoptic_ros.io.files import read_yaml
from panoptic_ros.io.occluders import read_occluders
from panoptic_ros.params import Config


def add_occluder_option(parser: argparse.ArgumentParser) -> None:
    """What stands between cameras and people."""
    parser.add_argument("--occluders", type=Path, metavar="FILE",
                        help="fixed things that hide people: occluders.json, PLY or OBJ")  # fmt: skip


def with_occluders(rig: Rig, path: Path | None) -> Rig:
    """The rig among the things of a file, if one is given."""
    return rig if path is None else replace(rig, occluders=read_occluders(path))


def add_parameter_options(parser: argparse.ArgumentParser) -> None:
    """--config FILE and --set stage.name=value."""
    parser.add_argument(
        "--config", type=Path, metavar="FILE",
        help="YAML with parameters, {stage: {name: value}}, or a ROS parameter file",
    )  # fmt: skip
    parser.add_argument(
        "--set", action="append", default=[], metavar="STAGE.NAME=VALUE", dest="settings",
        help="one parameter; may be given several times (see docs/parameters.md)",
    )  # fmt: skip


def number(kind: type[int] | type[float], low: float, high: float) -> Callable[[str], float]:
    """For `type` of an option: a number in a range; argparse tells the user what it says otherwise."""

    def parse(text: str) -> float:
        try:
            value = kind(text)
        except ValueError:
            value = float("nan")
        if not low <= value <= high:
            whole = "whole number" if kind is int else "number"
            raise argparse.ArgumentTypeError(f"{text!r} is not a {whole} from {low:g} to {high:g}")
        return value

    return parse


def read_parameters(args: argparse.Namespace) -> dict[str, dict[str, Any]]:
    """The parameters that the user gave: the file's, then those of --set.

    Raises:
        ConfigError: on unknown ones and bad values.
    """
    values: dict[str, dict[str, Any]] = {}
    if args.config is not None:
        document = read_yaml(args.config) or {}
        if not isinstance(document, dict) or not all(isinstance(v, dict) for v in document.values()):
            raise ConfigError(f"{args.config} must hold {{stage: {{parameter: value}}}}")
        values = {str(stage): dict(_plain(entries)) for stage, entries in document.items()}
    for text in args.settings:
        stage, name, value = parse_setting(text)
        values.setdefault(stage, {})[name] = value
    configure(values)  # so that mistakes are told before anything starts
    return values


def _plain(entries: dict[str, Any]) -> dict[str, Any]:
    """Entries of a ROS parameter file, as config/*.yaml are, stand one level deeper."""
    inner = entries.get("ros__parameters")
    return inner if isinstance(inner, dict) and len(entries) == 1 else entries


def with_defaults(
    given: dict[str, dict[str, Any]], defaults: dict[str, dict[str, Any]]
) -> dict[str, Config]:
    """Configurations where `defaults` count only where the user gave nothing."""
    stages = {**defaults, **given}
    return configure({s: {**defaults.get(s, {}), **given.get(s, {})} for s in stages})
