"""Values as a tree for JSON, and arrays beside it.

None, bool, int, str and finite floats stand for themselves. All else is a list that begins with a tag:

    x  float that is not finite, 8 bytes as hexadecimal digits
    v  scalar of numpy: type, bytes as hexadecimal digits
    a  array: type, shape; A = read-only. If it does not lie in C order: the axes from the slowest to the
       quickest, and whether there are gaps
    t l q s z d c  tuple, list, deque (with its limit), set, frozenset, dict, Counter: items, or keys, values
    #  inside of those, in place of many ints or floats: type and number, the values being an array
    e  member of an Enum: number of the class in the layout, name
    o  object: number of the class in the layout, fields in its order
    &  the object with that number again. What can change is counted as it begins: arrays that are not
       read-only, containers but for tuples and frozensets, and objects; values are written each time
    =  an object that the stage has from its constructor, by name
"""

from __future__ import annotations

import math
import struct
from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping
from enum import Enum
from typing import Any

import numpy as np

from panoptic_ros.errors import ContractError
from panoptic_ros.state.layout import StateLayout

Array = np.ndarray
PLAIN = frozenset((type(None), bool, int, str))
VALUES = frozenset((tuple, frozenset))  # containers that cannot change
MANY = 8  # ints or floats from which on they are written as an array
KINDS = "biufcSU"  # of arrays


class Writer:
    """Turns the values of one state into a tree; its arrays are kept in order."""

    def __init__(self, layout: StateLayout, shared: Mapping[str, Any]):
        self._layout = layout
        self._names = {id(value): name for name, value in shared.items() if type(value) not in PLAIN}
        self._attributes = [frozenset(fields.names) for fields in layout.classes]
        self._numbers: dict[int, int] = {}  # of what was written, by id; the stage keeps all of it alive
        self._made: list[Any] = []  # for this writer alone; kept, as ids of what is gone are given again
        self.arrays: list[Array] = []
        self._writers: dict[type, Callable[[Any], list[Any]]] = {
            np.ndarray: self._array,
            tuple: lambda value: ["t", *self._items(value)],
            list: lambda value: ["l", *self._items(value)],
            deque: lambda value: ["q", value.maxlen, *self._items(value)],
            set: lambda value: ["s", *self._items(sorted(value, key=repr))],
            frozenset: lambda value: ["z", *self._items(sorted(value, key=repr))],
            dict: lambda value: ["d", *self._pairs(value)],
            Counter: lambda value: ["c", *self._pairs(value)],
        }

    def node(self, value: Any) -> Any:
        """The tree of a value.

        Raises:
            ContractError: if the layout lacks its class or one of its attributes.
        """
        kind = type(value)
        if kind in PLAIN:
            return value
        if kind is float:
            return value if math.isfinite(value) else ["x", struct.pack("<d", value).hex()]
        key = id(value)
        if key in self._names:
            return ["=", self._names[key]]
        if key in self._numbers:
            return ["&", self._numbers[key]]
        write = self._writers.get(kind)
        if write is None:
            return self._object(value)
        if value.flags.writeable if kind is np.ndarray else kind not in VALUES:
            self._numbers[key] = len(self._numbers)
        return write(value)

    def _items(self, values: Iterable[Any]) -> list[Any]:
        values = list(values)
        kinds = set(map(type, values)) if len(values) >= MANY else set()
        if kinds == {float} or (kinds == {int} and max(map(abs, values)) < 2**63):
            packed = np.array(values, np.int64 if kinds == {int} else np.float64)
            self.arrays.append(packed)
            return [["#", packed.dtype.str, len(values)]]
        return [self.node(value) for value in values]

    def _pairs(self, values: Mapping[Any, Any]) -> list[Any]:
        return [self.node(each) for pair in values.items() for each in pair]

    def _array(self, array: Array) -> list[Any]:
        if array.dtype.kind not in KINDS:
            raise ContractError(f"the state of {self._layout.stage} holds an array of {array.dtype}")
        node: list[Any] = ["a" if array.flags.writeable else "A", array.dtype.str, list(array.shape)]
        if array.flags.c_contiguous or 0 in array.strides:
            self.arrays.append(array)
            return node
        axes = slowest_first(array)
        self.arrays.append(array.transpose(axes))
        dense = self.arrays[-1].flags.c_contiguous
        return [*node, axes, not dense]

    def _object(self, value: Any) -> list[Any]:
        number = self._layout.index.get(type(value))
        if number is None:
            return self._scalar(value)
        if isinstance(value, Enum):
            return ["e", number, value.name]
        fields = self._layout.classes[number]
        if not fields.is_value:
            self._numbers[id(value)] = len(self._numbers)
        more = getattr(value, "__dict__", {}).keys() - self._attributes[number]
        if more and fields.make is None:
            also, stage = ", ".join(sorted(more)), self._layout.stage
            raise ContractError(f"the layout of {stage} says {fields.text}, but it has {also}, too")
        content = [getattr(value, name) for name in fields.names]
        self._made.append(content)
        return ["o", number, *(self.node(each) for each in content)]

    def _scalar(self, value: Any) -> list[Any]:
        if isinstance(value, np.generic):
            return ["v", value.dtype.str, value.tobytes().hex()]
        kind = type(value).__name__
        raise ContractError(f"the state of {self._layout.stage} holds a {kind}; enter it in the layout")


def slowest_first(array: Array) -> list[int]:
    """The axes from the largest stride to the smallest; first those of length 1, whose stride is no order."""
    return sorted(
        range(array.ndim), key=lambda k: (array.shape[k] > 1, -abs(array.strides[k]) * (array.shape[k] > 1))
    )
