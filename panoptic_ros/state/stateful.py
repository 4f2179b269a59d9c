"""Converts the state of a stage to bytes and back.

The bytes begin with a fixed head: mark (8 bytes), version, length of the text, total length (unsigned,
little-endian), and the BLAKE2b hash of the rest. A JSON text follows, which identifies the stage and contains
its values as a tree. The arrays follow the text, one after another. Each begins at a multiple of 16 bytes
from the end of the text.

In the tree, None, bool, int, str and finite floats represent themselves. Every other value is a list that
begins with a tag:

    x  Non-finite float: 8 bytes as hexadecimal digits.
    v  Numpy scalar: dtype, bytes as hexadecimal digits.
    a  Array: dtype, shape. If it is not in C order, the axes from the slowest to the fastest follow, and
       whether the memory has gaps.
    A  Read-only array, otherwise as a.
    t l q s z d c
       Tuple, list, deque (with its maximum length), set, frozenset, dict, Counter: items, or keys and values.
    #  Inside those, instead of many ints or floats: dtype and count. The values are an array.
    e  Enum member: index of its class in the layout, name.
    o  Object: index of its class in the layout, fields in the order of the layout.
    &  Reference to a mutable object, by its number. Writable arrays, containers except tuple and frozenset,
       and objects are numbered in the order in which their writing begins. Immutable values are repeated.
    =  Reference to an object that the stage has from its constructor, by name.
"""

from __future__ import annotations

import json
import math
import struct
from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from enum import Enum
from hashlib import blake2b
from math import prod
from typing import Any, ClassVar

import numpy as np

from panoptic_ros.errors import ContractError, DataError
from panoptic_ros.state.layout import StateLayout

MARK = b"PANSTATE"
VERSION = 1
ALIGNMENT = 16
FIXED = struct.Struct("<8sIQQ16s")


def closed(
    layout: StateLayout, conditions: Mapping[str, str], tree: Any, arrays: Sequence[np.ndarray]
) -> bytes:
    """Return the state of a stage as bytes.

    Args:
        conditions: hashes of what must be equal, see `StateLayout`.
        tree: values of the state, see `StateWriter`.
        arrays: arrays of the tree, in order.
    """
    head = {"stage": layout.stage, "layout": layout.schema, "same": dict(conditions), "tree": tree}
    text = json.dumps(head, allow_nan=False, separators=(",", ":")).encode()
    parts = [text]
    for array in arrays:
        parts += [array.tobytes(), bytes(-array.nbytes % ALIGNMENT)]
    body = b"".join(parts)
    fixed = FIXED.pack(MARK, VERSION, len(text), FIXED.size + len(body), _digest(body))
    return fixed + body


def opened(layout: StateLayout, conditions: Mapping[str, str], state: bytes) -> tuple[Any, memoryview]:
    """Check the bytes of a state; return its tree and the bytes of its arrays.

    Raises:
        DataError: if the bytes are not a complete state of this kind of stage.
    """
    what = f"the state to begin {layout.stage} from"
    if len(state) < FIXED.size or state[: len(MARK)] != MARK:
        raise DataError(f"{what} is not the state of a stage: give the bytes that {layout.stage} handed over")
    _, version, text_length, length, digest = FIXED.unpack_from(state)
    if version != VERSION:
        raise DataError(f"{what} is of format {version}, this version has {VERSION}; hand it over again")
    body = memoryview(state)[FIXED.size :]
    if len(state) != length or digest != _digest(body):
        raise DataError(
            f"{what} is damaged: {len(state)} of {length} bytes, wrong checksum; hand it over again"
        )
    try:
        head = json.loads(bytes(body[:text_length]))
        _check(layout, conditions, head, what)
        return head["tree"], body[text_length:]
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise DataError(f"{what} has no readable head: {error!r}; hand it over again") from None


def _check(layout: StateLayout, conditions: Mapping[str, str], head: Mapping[str, Any], what: str) -> None:
    if head["stage"] != layout.stage:
        raise DataError(f"{what} is one of {head['stage']}; give the bytes that {layout.stage} handed over")
    if head["layout"] != layout.schema:
        raise DataError(f"{what} was handed over by another version of the stage; hand it over again")
    other = [name for name, value in conditions.items() if head["same"][name] != value]
    if other:
        raise DataError(f"{what} is of a stage with different {' and '.join(other)}; begin with the same")


def _digest(body: bytes | memoryview) -> bytes:
    return blake2b(body, digest_size=16).digest()


Array = np.ndarray
PLAIN = frozenset((type(None), bool, int, str))
VALUES = frozenset((tuple, frozenset))  # immutable containers
MANY = 8  # minimum number of ints or floats that are written as an array
KINDS = "biufcSU"  # permitted dtype kinds of arrays


class StateWriter:
    """Converts the values of one state to a tree, and collects their arrays in order."""

    def __init__(self, layout: StateLayout, shared: Mapping[str, Any]):
        self._layout = layout
        self._names = {id(value): name for name, value in shared.items() if type(value) not in PLAIN}
        self._attributes = [frozenset(fields.names) for fields in layout.classes]
        # numbers of the written mutable objects by id(); the stage keeps these objects alive
        self._numbers: dict[int, int] = {}
        # lists made by this writer; kept alive, as Python reuses the ids of freed objects
        self._made: list[Any] = []
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
        """Return the tree of a value.

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
    """Return the axes in order of decreasing stride.

    Axes of length 1 come first, as their strides imply no order.
    """
    return sorted(
        range(array.ndim), key=lambda k: (array.shape[k] > 1, -abs(array.strides[k]) * (array.shape[k] > 1))
    )


UNFINISHED = object()
NO_NUMBER = -1  # immutable values have no number


class StateReader:
    """Restores the values of one state from its tree and arrays.

    No code of the value classes runs, as fields are set directly. The exception is a class with a `make`
    function in the layout.
    """

    def __init__(self, layout: StateLayout, shared: Mapping[str, Any], data: memoryview):
        self._layout, self._shared, self._data = layout, shared, data
        self._position = 0
        self._found: list[Any] = []  # mutable objects by number, in the order in which their reading begins
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
        """Return the values of the state, in the order of the layout's attributes.

        Raises:
            DataError: if the tree does not match the layout.
        """
        try:
            values = self.node(tree)
            if type(values) is list and len(values) == len(self._layout.attributes):
                return values
            problem = "other attributes"
        except (ValueError, LookupError, TypeError, AttributeError, RecursionError, struct.error) as error:
            problem = repr(error)
        stage = self._layout.stage
        raise DataError(f"the state to begin {stage} from cannot be read ({problem}); hand it over again")

    def node(self, node: Any) -> Any:
        """Return the value of a tree."""
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

    # Containers that may contain themselves are registered before they are filled.

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
            name = self.node(key)  # key before value, in the order of writing
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
            raise ValueError(f"{cls.__name__} is not an Enum")
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
        """Return the next array of the data with its original memory layout.

        Args:
            axes: axes in memory order, from the slowest to the fastest.
            gaps: whether the array had gaps in memory.
        """
        dense = self._values(dtype, prod(shape)).reshape([shape[k] for k in axes])
        if gaps:
            wide = np.zeros((*dense.shape[:-1], 2 * dense.shape[-1]), dtype)
            wide[..., ::2] = dense
            dense = wide[..., ::2]
        return dense.transpose(np.argsort(axes))

    def _values(self, dtype: np.dtype[Any], count: int) -> Array:
        """Return a copy of the next array in the data."""
        if count < 0:
            raise ValueError(f"an array of {count} values")
        start, size = self._position, count * dtype.itemsize
        if start + size > len(self._data):
            raise ValueError("an array goes beyond the end")
        self._position = start + size + -size % ALIGNMENT
        return np.frombuffer(self._data[start : start + size], dtype).copy()


def _plain(text: str) -> np.dtype[Any]:
    """Return a dtype of numbers or text.

    Raises:
        ValueError: for any other dtype, e.g. one that holds objects.
    """
    try:
        dtype = np.dtype(text)
    except SyntaxError as error:  # numpy parses text with commas as Python
        raise ValueError(f"an array of {text!r}") from error
    if dtype.kind not in KINDS:
        raise ValueError(f"an array of {dtype}")
    return dtype


class Stateful:
    """Mixin that gives a stage with a `LAYOUT` the methods `state`, `begin` and `forget`."""

    LAYOUT: ClassVar[StateLayout]

    def reset(self) -> None:
        """Reset the stage to its state after construction."""
        raise NotImplementedError

    def forget(self) -> None:
        """Discard the measurements, but keep the layout's lasting attributes, such as used ids."""
        kept = {name: getattr(self, name) for name in self.LAYOUT.lasting}
        self.reset()
        for name, value in kept.items():
            setattr(self, name, value)

    def state(self) -> bytes:
        """Return everything that later steps depend on, as bytes. The stage is unchanged."""
        layout = self.LAYOUT
        writer = StateWriter(layout, layout.shared_objects(self))
        tree = writer.node(layout.values(self))
        return closed(layout, layout.conditions(self), tree, writer.arrays)

    def begin(self, state: bytes) -> None:
        """Replace the stage's own state by a result of `state`.

        Raises:
            DataError: if the bytes are incomplete, or belong to another kind of stage, version, configuration
                or context. The stage is then unchanged.
        """
        layout = self.LAYOUT
        tree, data = opened(layout, layout.conditions(self), state)
        layout.set_values(self, StateReader(layout, layout.shared_objects(self), data).values(tree))
