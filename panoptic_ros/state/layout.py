"""Which attributes of a stage are its state, and of which classes its content may be."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any


@dataclass(frozen=True)
class Fields:
    """A class whose instances may be part of a state, and the names of all of their attributes.

    Args:
        is_value: instances never change, so it does not matter whether two are one and the same.
        make: makes an instance from the values of these names, where they are not all of its attributes and
            the rest, such as large tables, follows from them. It must bear any values.
    """

    cls: type
    names: tuple[str, ...]
    is_value: bool = False
    make: Callable[..., Any] | None = None

    @classmethod
    def named(
        cls, owner: type, names: str, *, is_value: bool = False, make: Callable[..., Any] | None = None
    ) -> Fields:
        """Of a plain class, whose attributes nothing but this list tells: "a b c"."""
        return cls(owner, tuple(names.split()), is_value, make)

    @classmethod
    def of(cls, entry: type | Fields) -> Fields:
        """Of a dataclass, NamedTuple or Enum, which tell their fields themselves; others as they are."""
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
        """For the hash of the layout."""
        return f"{self.cls.__name__}({' '.join(self.names)})"


class StateLayout:
    """The state of one kind of stage.

    Names of attributes may be dotted, of parts of the stage; a part that is None has no state.

    Args:
        stage: its name, for the head of the bytes and for errors.
        attributes: that are the state: all that a step may change and a later one may look at.
        classes: of the objects in it, besides plain values, arrays and containers.
        shared: attributes that stay as the constructor made them, but that parts of the state refer to.
        lasting: those of the attributes that a stage keeps when it forgets what it measured.
        same: what must be equal in a stage that begins from a state, by what errors call it, e.g.
            {"cameras": "_rig.names"}; compared by hashes of `repr`.
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
        """The state, attribute by attribute."""
        return [_value(stage, name) for name in self.attributes]

    def set_values(self, stage: object, values: Iterable[Any]) -> None:
        """Replace the state."""
        for name, value in zip(self.attributes, values, strict=True):
            owner, last = _place(stage, name)
            if owner is not None:
                setattr(owner, last, value)

    def shared_objects(self, stage: object) -> dict[str, Any]:
        """What the state refers to without holding it."""
        return {name: _value(stage, name) for name in self.shared}

    def conditions(self, stage: object) -> dict[str, str]:
        """Hashes of what must be equal."""
        return {what: _hash(repr(_value(stage, name))) for what, name in self.same.items()}


def _value(stage: object, name: str) -> Any:
    owner, last = _place(stage, name)
    return None if owner is None else getattr(owner, last)


def _place(stage: object, name: str) -> tuple[Any, str]:
    """The part of a stage that has an attribute, None if it is not there, and the attribute's last name."""
    *path, last = name.split(".")
    for part in path:
        stage = None if stage is None else getattr(stage, part)
    return stage, last


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:32]
