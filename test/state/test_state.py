"""What a state can hold, that it comes back to the last bit, and which bytes are refused."""

from __future__ import annotations

import struct
from collections import Counter, deque
from dataclasses import dataclass, field
from enum import Enum
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from panoptic_ros.errors import ContractError, DataError
from panoptic_ros.state import Fields, Stateful, StateLayout
from panoptic_ros.state.stateful import FIXED, MARK, closed


class Colour(Enum):
    RED = 1
    BLUE = 2


class Pair(NamedTuple):
    left: Any
    right: Any


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    values: np.ndarray

    def __post_init__(self) -> None:
        raise AssertionError("no code of a class may run")


@dataclass
class Queue:
    items: deque[int] = field(default_factory=deque)


class Plain:
    def __init__(self, a: Any, b: Any):
        self.a, self.b = a, b


CLASSES = (
    Colour,
    Pair,
    Record,
    Queue,
    Fields.named(Fraction, "_numerator _denominator", is_value=True),
    Fields.named(Plain, "a b"),
)


class Toy(Stateful):
    """A stage that remembers one value."""

    LAYOUT = StateLayout("toy", ("memory",), CLASSES, shared=("rules",), same={"cameras": "cameras"})

    def __init__(self, memory: Any = None, cameras: tuple[str, ...] = ("a", "b")):
        self.memory, self.cameras, self.rules = memory, cameras, [1, 2, 3]


def through(value: Any) -> Any:
    """What a second stage remembers after it began from the state of a first; the bytes are stable."""
    first, second = Toy(value), Toy("something else")
    state = first.state()
    second.begin(state)
    assert first.memory is value and second.state() == state
    return second.memory


def record(values: np.ndarray) -> Record:
    """As restored: without the check."""
    made = object.__new__(Record)
    object.__setattr__(made, "values", values)
    return made


PLAIN = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.text()
    | st.floats(allow_nan=False)
    | st.sampled_from(Colour)
)
KEYS = st.integers() | st.text() | st.tuples(st.integers(), st.text())
VALUES = st.recursive(
    PLAIN,
    lambda inner: (
        st.lists(inner)
        | st.lists(inner).map(tuple)
        | st.dictionaries(KEYS, inner)
        | st.builds(Pair, inner, inner)
        | st.lists(inner).map(lambda items: deque(items, maxlen=20))
    ),
    max_leaves=12,
)


@given(VALUES)
def test_values_come_back_with_their_types(value: Any) -> None:
    found = through(value)
    assert found == value and repr(found) == repr(value)


@given(st.lists(st.integers(-(2**70), 2**70), min_size=5, max_size=12), st.lists(st.floats(), min_size=8))
def test_long_rows_of_numbers_come_back_as_numbers(ints: list[int], floats: list[float]) -> None:
    found = through((ints, deque(floats, maxlen=99)))
    assert found[0] == ints and {type(value) for value in found[0]} == {int}
    assert [struct.pack("<d", v) for v in found[1]] == [struct.pack("<d", v) for v in floats]


@pytest.mark.parametrize("bits", [0x7FF8000000000000, 0xFFF8000000001234, 0x7FF0000000000000, 1 << 63, 1])
def test_floats_keep_their_bits(bits: int) -> None:
    (number,) = struct.unpack("<d", struct.pack("<Q", bits))
    array = np.array([bits], np.uint64).view(np.float64)
    found = through([number, array, array[0]])
    assert [np.float64(each).tobytes() for each in (found[0], found[1][0], found[2])] == 3 * [array.tobytes()]
    assert type(found[0]) is float and type(found[2]) is np.float64


@pytest.mark.parametrize(
    "array",
    [
        np.arange(6.0).reshape(2, 3),
        np.array(2.5),
        np.zeros((0, 3)),
        np.zeros((3, 0), np.int32),
        np.array([True, False]),
        np.array(["left", "b"]),
        np.arange(3, dtype=np.uint8),
        np.arange(24).reshape(2, 3, 4).T,
        np.arange(24.0).reshape(2, 3, 4).transpose(1, 0, 2),
        np.arange(24.0).reshape(2, 3, 4)[:, :, 1:3],
        np.arange(9.0)[::3],
        np.arange(9.0)[::-1],
        np.broadcast_to(np.arange(3.0), (2, 3)),
        np.asfortranarray(np.arange(6.0).reshape(2, 3, 1)),
    ],
    ids=lambda array: f"{array.dtype}{array.shape}{array.strides}",
)
def test_arrays_keep_type_shape_and_order_in_memory(array: np.ndarray) -> None:
    found = through(array)
    assert found.dtype == array.dtype and found.shape == array.shape
    assert found.tobytes() == array.tobytes()
    if 0 not in array.strides:
        assert found.flags.c_contiguous == array.flags.c_contiguous
        assert found.flags.f_contiguous == array.flags.f_contiguous
        assert np.argsort(found.strides).tolist() == np.argsort(np.abs(array.strides)).tolist()
    assert found.flags.writeable == array.flags.writeable


def test_records_are_restored_without_their_checks_and_stay_read_only() -> None:
    values = np.array([1.0, np.nan])
    values.flags.writeable = False
    found = through(record(values))
    assert type(found) is Record and found.values.tobytes() == values.tobytes()
    assert not found.values.flags.writeable


def test_sets_counters_and_plain_objects() -> None:
    value = ({3, 1, 2}, frozenset("ab"), Counter("banana"), Fraction(30000, 1001), {(1, "x"): {}})
    found = through(value)
    assert found == value and [type(each) for each in found] == [type(each) for each in value]
    queue = through(Queue(deque([1, 2], maxlen=2)))
    assert queue == Queue(deque([1, 2])) and queue.items.maxlen == 2


def test_what_is_shared_stays_shared() -> None:
    array, queue = np.zeros(3), Queue()
    found = through({"one": array, "two": [array, queue], "three": (queue,)})
    assert found["one"] is found["two"][0] and found["two"][1] is found["three"][0]
    found["one"][0] = 1.0
    assert array[0] == 0.0


def test_equal_values_are_equal_bytes_whether_they_are_one_object_or_two() -> None:
    values, other = np.zeros(3), np.zeros(3)
    values.flags.writeable = other.flags.writeable = False
    for one, same in (
        (values, other),
        (record(values), record(other)),
        ((1, 2), tuple([1, 2])),
        (Fraction(1, 3), Fraction(1, 3)),
        (Pair(1, 2), Pair(1, 2)),
    ):
        assert Toy([one, one]).state() == Toy([one, same]).state()
    changing = np.zeros(3)
    assert Toy([changing, changing]).state() != Toy([changing, changing.copy()]).state()


def test_objects_may_refer_to_each_other() -> None:
    first = Plain(1, None)
    first.b = Plain([first], 2)
    found = through(first)
    assert found.b.a[0] is found and found.b.b == 2


def test_parts_of_the_constructor_are_referred_to_by_name() -> None:
    first, second = Toy(), Toy()
    first.memory = Plain(first.rules, 0)
    second.begin(first.state())
    assert second.memory.a is second.rules


def test_a_class_that_nobody_entered_is_a_bug() -> None:
    with pytest.raises(ContractError, match="the state of toy holds a StateLayout"):
        Toy([Toy.LAYOUT]).state()
    with pytest.raises(ContractError, match="array of object"):
        Toy(np.array([None])).state()


def test_an_attribute_that_nobody_entered_is_a_bug() -> None:
    thing = Plain(1, 2)
    thing.c = 3  # type: ignore[attr-defined]
    with pytest.raises(ContractError, match=r"says Plain\(a b\), but it has c, too"):
        Toy(thing).state()


class Other(Toy):
    LAYOUT = StateLayout("other", ("memory",))


class Older(Toy):
    LAYOUT = StateLayout("toy", ("memory",), CLASSES[:-1], shared=("rules",), same={"cameras": "cameras"})


STATE = Toy([1.5, np.arange(5), Plain(1, 2)]).state()


@pytest.mark.parametrize(
    ("stage", "state", "words"),
    [
        (Toy(), b"", "is not the state of a stage"),
        (Toy(), b"\x80\x04K\x01." + bytes(99), "is not the state of a stage"),
        (Toy(), STATE[:-1], "is damaged"),
        (Toy(), STATE + b"x", "is damaged"),
        (Toy(), STATE[: FIXED.size], "is damaged"),
        (Toy(), STATE.replace(b"toy", b"tof"), "is damaged"),
        (Toy(), MARK + struct.pack("<I", 2) + STATE[len(MARK) + 4 :], "is of format 2, this version has 1"),
        (Other(), STATE, "is one of toy"),
        (Older(), STATE, "by another version of the stage"),
        (Toy(cameras=("a", "c")), STATE, "of a stage with different cameras; begin with the same"),
    ],
)
def test_foreign_and_damaged_bytes_are_refused_in_one_line(stage: Toy, state: bytes, words: str) -> None:
    stage.memory = before = object()
    with pytest.raises(DataError, match=words) as caught:
        stage.begin(state)
    text = str(caught.value)
    assert f"the state to begin {stage.LAYOUT.stage} from" in text and "\n" not in text
    assert stage.memory is before


@given(st.integers(0, len(STATE) - 1), st.integers(1, 255))
def test_no_changed_byte_goes_unnoticed(place: int, change: int) -> None:
    damaged = bytearray(STATE)
    damaged[place] ^= change
    with pytest.raises(DataError):
        Toy().begin(bytes(damaged))


NODES = st.recursive(
    st.none() | st.integers(-3, 5) | st.text(max_size=2) | st.sampled_from(["<f8", "|O", "=", "rules"]),
    lambda inner: st.builds(
        lambda tag, rest: [tag, *rest], st.sampled_from([*"xvaAtlqszdceo&=#"]), st.lists(inner, max_size=4)
    ),
    max_leaves=10,
)


@given(NODES)
def test_trees_that_make_no_sense_are_refused_or_harmless(tree: Any) -> None:
    """With a right checksum: a stranger may have written it."""
    stage = Toy()
    layout = stage.LAYOUT
    state = closed(layout, layout.conditions(stage), ["l", tree], [np.zeros(2)])
    try:
        stage.begin(state)
    except DataError as error:
        assert "cannot be read" in str(error)
        assert stage.memory is None
