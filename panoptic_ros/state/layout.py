"""Defines which attributes of a stage are its state, and which classes that state may contain."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any


@dataclass(frozen=True)
class Fields:
    """Class whose instances may be part of a state, with the names of all of its attributes.

    Args:
        cls: The class.
        names: Names of the attributes to store.
        is_value: Instances are immutable, so their identity does not matter.
        make: Makes an instance from the values of `names`. It is needed if `names` are not all attributes,
            because others, such as large tables, follow from them. It must accept any values.
    """

    cls: type
    names: tuple[str, ...]
    is_value: bool = False
    make: Callable[..., Any] | None = None

    @classmethod
    def named(
        cls, owner: type, names: str, *, is_value: bool = False, make: Callable[..., Any] | None = None
    ) -> Fields:
        """Return the fields of a plain class. Only this list, e.g. "a b c", states its attributes."""
        return cls(owner, tuple(names.split()), is_value, make)

    @classmethod
    def of(cls, entry: type | Fields) -> Fields:
        """Return the `Fields` of a dataclass, NamedTuple or Enum.

        The class itself declares its attributes, unlike a plain class (see `named`). An entry
        that is `Fields` already is returned unchanged.
        """
        if isinstance(entry, Fields):
            return entry
        if issubclass(entry, Enum):
            return cls(entry, (), is_value=True)
        if dataclasses.is_dataclass(entry):
            frozen: bool = entry.__dataclass_params__.frozen  # type: ignore[attr-defined]  # not in the stubs
            return cls(entry, tuple(field.name for field in dataclasses.fields(entry)), frozen)
        return cls(entry, tuple(entry._fields), is_value=True)  # type: ignore[attr-defined]  # a NamedTuple

    @property
    def text(self) -> str:
        """Return the text that represents this class in the hash of the layout."""
        return f"{self.cls.__name__}({' '.join(self.names)})"


class StateLayout:
    """Layout of the state of one kind of stage.

    Attribute names may contain dots to address parts of the stage. A part that is None has no state.

    Args:
        stage: Name of the stage, for the head of the bytes and for errors.
        attributes: Names of the attributes that form the state. A step may change them, and a later step may
            read them.
        classes: Classes of the objects in the state, in addition to plain values, arrays and containers.
        shared: Attributes that stay as the constructor made them, but that parts of the state refer to.
        lasting: Those of `attributes` that a stage keeps in `forget`.
        same: Attributes that must be equal in a stage that begins from a state, by their names in errors,
            e.g. {"cameras": "_rig.names"}. Hashes of their `repr` are compared.
    """

    def __init__(
        self,
        stage: str,
        attributes: Iterable[str],
        classes: Iterable[type | Fields] = (),
        shared: Iterable[str] = (),
        lasting: Iterable[str] = (),
        same: Mapping[str, str] | None = None,
    ):
        self.stage = stage
        self.attributes, self.shared, self.lasting = tuple(attributes), tuple(shared), tuple(lasting)
        self.same = dict(same or {})
        self.classes = tuple(Fields.of(entry) for entry in classes)
        self.index = {fields.cls: k for k, fields in enumerate(self.classes)}
        names = [self.stage, *self.attributes, *self.shared, *(fields.text for fields in self.classes)]
        self.schema = _hash("\n".join(names))

    def values(self, stage: object) -> list[Any]:
        """Return the values of the state, in the order of `attributes`."""
        return [_value(stage, name) for name in self.attributes]

    def set_values(self, stage: object, values: Iterable[Any]) -> None:
        """Replace the state by these values."""
        for name, value in zip(self.attributes, values, strict=True):
            owner, last = _place(stage, name)
            if owner is not None:
                setattr(owner, last, value)

    def shared_objects(self, stage: object) -> dict[str, Any]:
        """Return the objects that the state refers to but does not contain, by name."""
        return {name: _value(stage, name) for name in self.shared}

    def conditions(self, stage: object) -> dict[str, str]:
        """Return the hashes of the attributes that must be equal, by their names in errors."""
        return {what: _hash(repr(_value(stage, name))) for what, name in self.same.items()}


def _value(stage: object, name: str) -> Any:
    owner, last = _place(stage, name)
    return None if owner is None else getattr(owner, last)


def _place(stage: object, name: str) -> tuple[Any, str]:
    """Return the part of a stage that owns an attribute, and the attribute's last name.

    The part is None if it does not exist.
    """
    *path, last = name.split(".")
    for part in path:
        stage = None if stage is None else getattr(stage, part)
    return stage, last


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:32]
