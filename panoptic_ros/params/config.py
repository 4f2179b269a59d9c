"""Defines `param` and `Config`, and derives mappings, texts and descriptions from configurations."""

from __future__ import annotations

import csv
import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeVar, get_type_hints

from panoptic_ros.errors import ConfigError, ContractError, nearest, shown

Value = bool | int | float | str | tuple[str, ...] | tuple[float, ...] | tuple[int, ...]

LONGEST_INTEGER = 1023  # bits of an integer that a float can hold
_SCALARS: tuple[type, ...] = (bool, int, float, str)
_TUPLES: dict[Any, type] = {tuple[str, ...]: str, tuple[float, ...]: float, tuple[int, ...]: int}
_KEY = "panoptic_param"


@dataclass(frozen=True)
class Param:
    """One parameter: name, type, default, unit, range and one sentence of documentation.

    Args:
        ge, le: inclusive lower and upper limit; None = no limit.
        choices: permitted values of a text; () = any.
        when: reason for a lab to change the parameter; "" = none, so only experts change it.
    """

    name: str
    type: Any  # bool, int, float, str or tuple[..., ...] of one of the latter three
    default: Value
    unit: str
    ge: float | None
    le: float | None
    choices: tuple[str, ...]
    doc: str
    when: str  # reason for a lab to change it; "" = only experts change it

    @property
    def expert(self) -> bool:
        """Return whether the parameter is for experts: its default suits every lab, as far as we know."""
        return not self.when

    @property
    def told(self) -> str:
        """Return the documentation, marked as "Expert" if the parameter is for experts."""
        return f"Expert: {self.doc}" if self.expert else self.doc


@dataclass(frozen=True)
class _Spec:
    unit: str
    ge: float | None
    le: float | None
    choices: tuple[str, ...]
    doc: str
    when: str


def param(
    default: Any,
    *,
    doc: str,
    unit: str = "",
    ge: float | None = None,
    le: float | None = None,
    choices: tuple[str, ...] = (),
    when: str = "",
) -> Any:
    """Return a dataclass field with a default, a unit, an inclusive range or choices, and a doc sentence.

    Args:
        when: in what case a lab changes the parameter, and to which value, for the first page of
            docs/parameters.md. Without it, the parameter is for experts. A new parameter should be for
            experts.
    """
    return dataclasses.field(default=default, metadata={_KEY: _Spec(unit, ge, le, choices, doc, when)})


@dataclass(frozen=True, kw_only=True)
class Config:
    """Base of all configurations. Construction checks types and ranges.

    Raises:
        ConfigError: naming the parameter, its value and the permitted values.
    """

    def __post_init__(self) -> None:
        for item in describe(type(self)):
            value = _checked(item, getattr(self, item.name), type(self).__name__)
            object.__setattr__(self, item.name, value)


C = TypeVar("C", bound=Config)


def describe(cls: type[Config]) -> tuple[Param, ...]:
    """Return all parameters of a configuration, in the order of the fields.

    Raises:
        ContractError: if a field was not made by `param`.
    """
    hints = get_type_hints(cls)
    rows = []
    for field in dataclasses.fields(cls):
        spec = field.metadata.get(_KEY)
        if spec is None:
            raise ContractError(f"{cls.__name__}.{field.name} was not made with param()")
        default: Any = field.default  # param() gives every field a default
        rows.append(Param(field.name, hints[field.name], default, **vars(spec)))
    return tuple(rows)


def load(cls: type[C], values: Mapping[str, Any], where: str = "") -> C:
    """Return a configuration from a mapping of names to values. Missing names keep their defaults.

    Args:
        where: prefix of the names in messages.

    Raises:
        ConfigError: on unknown names, wrong types or values out of range.
    """
    known = sorted(item.name for item in describe(cls))
    for name in values:
        if name not in known:
            raise ConfigError(f"unknown parameter {shown(where + name)}; {nearest(name, known)}")
    return cls(**values)


def config_of(configs: Mapping[str, Config], cls: type[C]) -> C:
    """Return the configuration of a class from those of all stages.

    Raises:
        ContractError: if there is none.
    """
    for config in configs.values():
        if type(config) is cls:
            return config
    raise ContractError(f"there is no {cls.__name__} among the configurations of {', '.join(configs)}")


def to_mapping(config: Config) -> dict[str, Any]:
    """Return the configuration as plain values that `load` accepts. Tuples become lists."""
    rows = ((item.name, getattr(config, item.name)) for item in describe(type(config)))
    return {name: list(value) if isinstance(value, tuple) else value for name, value in rows}


def diff(config: Config) -> dict[str, Any]:
    """Return the parameters that differ from their defaults."""
    default = to_mapping(type(config)())
    return {name: value for name, value in to_mapping(config).items() if value != default[name]}


def from_text(cls: type[Config], name: str, text: str) -> Any:
    """Return the value of parameter `name` from its text on a command line.

    A list is written as a,b or [a, b], or as ["a,b"] if an entry contains a comma.

    Raises:
        ConfigError: if the name is unknown, or the text is not a value of its type.
    """
    for item in describe(cls):
        if item.name == name:
            return _parse(item, text, cls.__name__)
    known = [item.name for item in describe(cls)]
    raise ConfigError(f"unknown parameter {shown(name)} of {cls.__name__}; {nearest(name, known)}")


def _parse(item: Param, text: str, owner: str) -> Any:
    try:
        if item.type in _TUPLES:
            kind = _TUPLES[item.type]
            inner = text.strip().removeprefix("[").removesuffix("]").strip()
            quote = "'" if inner.startswith("'") else '"'
            parts = next(csv.reader([inner], quotechar=quote, skipinitialspace=True, strict=True))
            return tuple(kind(part.strip()) for part in parts if part.strip())
        if item.type is bool:
            return {"true": True, "1": True, "false": False, "0": False}[text.strip().lower()]
        return item.type(text)
    except (KeyError, ValueError, csv.Error):
        raise ConfigError(f"{owner}.{item.name} = {shown(text)} is not a {_type_name(item.type)}") from None


def _type_name(kind: Any) -> str:
    return kind.__name__ if kind in _SCALARS else f"list of {_TUPLES[kind].__name__}"


def _checked(item: Param, value: Any, owner: str) -> Any:
    """Return the value, converted without loss to the parameter's type.

    Raises:
        ConfigError: if the type or the range is wrong.
        ContractError: if the parameter's type is not supported.
    """
    where = f"{owner}.{item.name}"
    if item.type in _TUPLES:
        if isinstance(value, str) or not isinstance(value, (list, tuple)):
            raise ConfigError(f"{where} = {shown(value)} is not a list")
        return tuple(_scalar(where, _TUPLES[item.type], entry, item) for entry in value)
    if item.type not in _SCALARS:
        raise ContractError(f"{where}: type {item.type} is not supported")
    return _scalar(where, item.type, value, item)


def _scalar(where: str, kind: type[Any], value: Any, item: Param) -> Any:
    if kind is float and type(value) is int and value.bit_length() <= LONGEST_INTEGER:
        value = float(value)
    if type(value) is not kind:
        raise ConfigError(f"{where} = {shown(value)} is not a {kind.__name__}")
    if kind is float and not math.isfinite(value):
        raise ConfigError(f"{where} = {shown(value)} is not finite")
    if kind is str and item.choices and value not in item.choices:
        raise ConfigError(f"{where} = {shown(value)} is none of {', '.join(item.choices)}")
    if kind in (int, float):
        if item.ge is not None and value < item.ge:
            raise ConfigError(f"{where} = {shown(value)} is below {item.ge} {item.unit}".rstrip())
        if item.le is not None and value > item.le:
            raise ConfigError(f"{where} = {shown(value)} is above {item.le} {item.unit}".rstrip())
    return value
