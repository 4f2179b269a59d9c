"""The way back from `writing`: values from a tree and the bytes of its arrays."""

from __future__ import annotations

import struct
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from enum import Enum
from math import prod
from typing import Any

import numpy as np

from panoptic_ros.errors import DataError
from panoptic_ros.state.envelope import ALIGNMENT
from panoptic_ros.state.layout import StateLayout
from panoptic_ros.state.writing import KINDS

Array = np.ndarray
UNFINISHED = object()
NO_NUMBER = -1  # of what cannot change


class Reader:
    """Makes the values of one state.

    No code of their classes runs: fields are set one by one. Only what the layout has a function for is made
    by it.
    """

    def __init__(self, layout: StateLayout, shared: Mapping[str, Any], data: memoryview):
        self._layout, self._shared, self._data = layout, shared, data
        self._position = 0
        self._found: list[Any] = []  # what can change, in the order in which it begins
        self._readers: dict[str, Callable[[Sequence[Any], int], Any]] = {
            "a": self._array,
            "A": self._array,
            "o": self._object,
            "q": self._deque,
            "l": self._list,
            "d": self._dict,
            "c": self._counter,
            "t": lambda node, _: tuple(self._items(node[1:])),
            "s": lambda node, _: set(self._items(node[1:])),
            "z": lambda node, _: frozenset(self._items(node[1:])),
        }

    def values(self, tree: Any) -> list[Any]:
        """What the state holds, in the order of the layout's attributes.

        Raises:
            DataError: if the tree is none of this layout.
        """
        try:
            values = self.node(tree)
            if type(values) is list and len(values) == len(self._layout.attributes):
                return values
            problem = "other attributes"
        except (ValueError, LookupError, TypeError, AttributeError, RecursionError, struct.error) as error:
            problem = repr(error)
        stage = self._layout.stage
        raise DataError(f"the state to begin {stage} from cannot be read ({problem}); hand it over anew")

    def node(self, node: Any) -> Any:
        """The value of a tree."""
        if type(node) is not list:
            return node
        tag = node[0]
        if tag == "x":
            return struct.unpack("<d", bytes.fromhex(node[1]))[0]
        if tag == "v":
            return np.frombuffer(bytes.fromhex(node[2]), _plain(node[1]))[0]
        if tag == "e":
            return self._member(node)
        if tag == "=":
            return self._shared[node[1]]
        if tag == "&":
            return self._again(node[1])
        if tag in "Atz" or (tag == "o" and self._layout.classes[node[1]].is_value):
            return self._readers[tag](node, NO_NUMBER)
        number = len(self._found)
        self._found.append(UNFINISHED)
        value = self._found[number] = self._readers[tag](node, number)
        return value

    def _again(self, number: int) -> Any:
        value = self._found[number]
        if value is UNFINISHED:
            raise ValueError("something holds itself that is made at the end")
        return value

    def _items(self, nodes: Sequence[Any]) -> list[Any]:
        if len(nodes) == 1 and type(nodes[0]) is list and nodes[0][0] == "#":
            found: list[Any] = self._values(_plain(nodes[0][1]), nodes[0][2]).tolist()
            return found
        return [self.node(node) for node in nodes]

    # Containers that may hold themselves are entered before they are filled.

    def _list(self, node: Sequence[Any], number: int) -> list[Any]:
        value: list[Any] = []
        self._found[number] = value
        value += self._items(node[1:])
        return value

    def _deque(self, node: Sequence[Any], number: int) -> deque[Any]:
        value: deque[Any] = deque(maxlen=node[1])
        self._found[number] = value
        value.extend(self._items(node[2:]))
        return value

    def _dict(self, node: Sequence[Any], number: int) -> dict[Any, Any]:
        return self._filled({}, node, number)

    def _counter(self, node: Sequence[Any], number: int) -> dict[Any, Any]:
        return self._filled(Counter(), node, number)

    def _filled(self, value: dict[Any, Any], node: Sequence[Any], number: int) -> dict[Any, Any]:
        self._found[number] = value
        for key, entry in zip(node[1::2], node[2::2], strict=True):
            name = self.node(key)  # first, as it was written
            value[name] = self.node(entry)
        return value

    def _object(self, node: Sequence[Any], number: int) -> Any:
        fields = self._layout.classes[node[1]]
        rows = zip(fields.names, node[2:], strict=True)
        if fields.make is not None:
            return fields.make(*[self.node(each) for _, each in rows])
        if issubclass(fields.cls, tuple):
            return tuple.__new__(fields.cls, [self.node(each) for _, each in rows])
        value = object.__new__(fields.cls)
        if not fields.is_value:
            self._found[number] = value
        for name, each in rows:
            object.__setattr__(value, name, self.node(each))
        return value

    def _member(self, node: Sequence[Any]) -> Any:
        cls = self._layout.classes[node[1]].cls
        if not issubclass(cls, Enum):
            raise ValueError(f"{cls.__name__} is no Enum")
        return cls[node[2]]

    def _array(self, node: Sequence[Any], number: int) -> Array:
        dtype, shape, *order = node[1:]
        if order:
            array = self._in_order(_plain(dtype), shape, *order)
        else:
            array = self._values(_plain(dtype), prod(shape)).reshape(shape)
        array.flags.writeable = node[0] == "a"
        return array

    def _in_order(self, dtype: np.dtype[Any], shape: Sequence[int], axes: Sequence[int], gaps: bool) -> Array:
        """An array whose axes lie in memory from the slowest to the quickest, with gaps if it had any."""
        dense = self._values(dtype, prod(shape)).reshape([shape[k] for k in axes])
        if gaps:
            wide = np.zeros((*dense.shape[:-1], 2 * dense.shape[-1]), dtype)
            wide[..., ::2] = dense
            dense = wide[..., ::2]
        return dense.transpose(np.argsort(axes))

    def _values(self, dtype: np.dtype[Any], count: int) -> Array:
        """The next array of the data, on its own."""
        if count < 0:
            raise ValueError(f"an array of {count} values")
        start, size = self._position, count * dtype.itemsize
        if start + size > len(self._data):
            raise ValueError("an array goes beyond the end")
        self._position = start + size + -size % ALIGNMENT
        return np.frombuffer(self._data[start : start + size], dtype).copy()


def _plain(text: str) -> np.dtype[Any]:
    """A type of numbers or texts; nothing that holds objects."""
    dtype = np.dtype(text)
    if dtype.kind not in KINDS:
        raise ValueError(f"an array of {dtype}")
    return dtype
