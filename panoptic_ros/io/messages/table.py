"""One table of fields for each message: it defines how to write a record as a message and read it back.

A table states for every message field its type and its place in the record. Sizes are letters: equal letters
are equal sizes, as in `domain.checks.ShapeChecks`. Each table is compiled to two functions that resemble
hand-written ones. So a message costs little more than its arrays:

    def write(r, family, frame_id):
        return family.make("TrackSet", index=int(r.index), ages=flat(family, r.ages, float64))

    def read(m):
        J = count(m.joint_count, "TrackSet.joint_count", 4096)
        ages = shaped(m.ages, "TrackSet.ages", T, J)
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from panoptic_ros.domain.checks import check_magnitude
from panoptic_ros.errors import DataError
from panoptic_ros.io.messages.family import MessageFamily, stamp_of, time_ns

Array = np.ndarray
Values = dict[str, Any]  # values of a record by attribute; "part.attribute" for values in a part of it
Getter = Callable[[Any], Any]
COUNT, TIME = "count", "time"  # field types: the size of a letter; a timestamp, int ns
LONGEST = 2**24  # limit of one dimension, also if another one is 0
MOST = {"J": 4096}  # limits by letter: no skeleton has more joints
LARGEST = 1e12  # m, px, s; larger values are invalid, and their squares would spoil sums


@dataclass(frozen=True)
class Field:
    """One field of a message.

    Args:
        name: Name in the message. "a b" names two fields that hold a pair of the record.
        kind: Type of its values: int, float, bool, str, a numpy type of an array, `TIME`, `COUNT`, or the
            `Table` of a nested message.
        shape: Dimensions of an array, as letters and numbers, such as "J 3". A list of names or messages
            and a `COUNT` have one letter. None = a scalar. Equal letters mean equal sizes. The first field
            with a letter sets its size.
        of: Attribute of the record that holds the value, such as "part.attribute"; "" = `name`. If it is a
            function, the function computes the value to write. Such a field is read only if it is optional,
            or for `Table.complete`.
        own: Type to which the array is converted when a message is read; None = the record converts it.
        optional: True = None in the record is an empty value in the message. If it is the name of another
            message field, that field is false, 0 or empty where this value is None.
    """

    name: str
    kind: Any
    shape: str | None = None
    of: str | Getter = ""
    own: Any = None
    optional: bool | str = False

    @property
    def key(self) -> str:
        """Return the attribute of the record."""
        return self.of if isinstance(self.of, str) and self.of else self.name

    @property
    def letters(self) -> tuple[str | int, ...]:
        """Return the sizes of the shape."""
        return tuple(int(size) if size.isdigit() else size for size in (self.shape or "").split())


@dataclass(frozen=True)
class PersonRows:
    """An array of messages, one per person; the record holds one array of all people for each field.

    Args:
        name: field name.
        message: type of the nested message.
        fields: shapes begin with the letter of the people; fields without further letters are scalars.
    """

    name: str
    message: str
    fields: tuple[Field, ...]


class Table:
    """Converter between a record and its message.

    Args:
        message: Message name.
        record: Record class.
        header: Attributes with the timestamp (int ns) and with the owner in the message header; "" = 0 and
            the world frame. None = the message has no header.
        parts: Parts of the record by attribute: class, and whether the part is None if its first value is
            empty.
        complete: Changes and checks the values that were read, before the record is built.
    """

    def __init__(
        self,
        message: str,
        record: type,
        header: tuple[str, str] | None,
        fields: tuple[Field | PersonRows, ...],
        parts: dict[str, tuple[type, bool]] | None = None,
        complete: Callable[[Values], None] | None = None,
    ):
        self.message, self.record, self.header, self.fields = message, record, header, fields
        self._parts, self._complete = parts or {}, complete
        source = _Source(message, {part for part, (_, optional) in self._parts.items() if optional})
        known = {field.name for field in dataclasses.fields(record)}
        source.add_header([(name, name in known) for name in header or ()])
        plain = [f for row in fields for f in (row.fields if isinstance(row, PersonRows) else (row,))]
        for row in fields:
            if isinstance(row, PersonRows):
                source.add_rows(row, complete is not None)
            else:
                source.add(row, plain, complete is not None)
        self.write: Callable[[Any, MessageFamily, str], Any]
        self.write, self._values_of = source.compiled(record, self._parts, complete is not None)

    def read(self, message: Any) -> Any:
        """Convert a message to its record.

        Raises:
            DataError: if array lengths are inconsistent, or values are invalid.
        """
        if self._complete is None:
            return self._values_of(message)
        values: Values = self._values_of(message)
        self._complete(values)
        inner: dict[str, Values] = {part: {} for part in self._parts}
        for key in [key for key in values if "." in key]:
            part, _, name = key.partition(".")
            inner[part][name] = values.pop(key)
        parts = {part: self._parts[part][0](**own) for part, own in inner.items()}
        return self.record(**values, **parts)


class _Source:
    """Source code of the two functions of a table.

    Args:
        optional: parts of the record that may be None.
    """

    def __init__(self, message: str, optional: Collection[str]):
        self._message, self._optional = message, optional
        self._names: Values = dict(_HELPERS)
        self._before_writing: list[str] = []
        self._written: list[str] = []  # "field=expression" lines
        self._reading: list[str] = []
        self._read: list[tuple[str, str]] = []  # (attribute, expression) pairs
        self._sizes: set[str] = set()

    def compiled(
        self, record: type, parts: dict[str, tuple[type, bool]], gives_values: bool
    ) -> tuple[Callable[..., Any], Callable[..., Any]]:
        """Compile and return the writer (record to message) and reader (message to record or its values)."""
        given = [f"{key!r}: {read}" for key, read in self._read if gives_values or "." not in key]
        for part, (kind, optional) in () if gives_values else parts.items():
            own = [(key[len(part) + 1 :], read) for key, read in self._read if key.startswith(f"{part}.")]
            self._reading += [f"    {part}_{name} = {read}" for name, read in own]
            first, inner = f"{part}_{own[0][0]}", ", ".join(f"{name}={part}_{name}" for name, _ in own)
            made = f"{self._named(kind)}({inner})"
            given.append(
                f"{part!r}: {made}" + optional * f" if {first} is not None and len({first}) else None"
            )
        values = f"{{{', '.join(given)}}}"
        lines = [
            "def write(r, family, frame_id):",
            *self._before_writing,
            f"    return family.make({self._message!r}, {', '.join(self._written)})",
            "def read(m):",
            *self._reading,
            f"    return {values if gives_values else f'{self._named(record)}(**{values})'}",
        ]
        exec(compile("\n".join(lines), f"<table of {self._message}>", "exec"), self._names)
        return self._names["write"], self._names["read"]

    def add_header(self, names: Sequence[tuple[str, bool]]) -> None:
        """Add the header.

        Args:
            names: attributes with the timestamp and the owner, each with whether the record is built with it.
        """
        if not names:
            return
        (stamp, takes_stamp), (owner, takes_owner) = names
        written = f"family.header({f'r.{stamp}' if stamp else 0}, {f'r.{owner}' if owner else 'frame_id'})"
        self._written.append(f"header={written}")
        self._read += [(stamp, "stamp_of(m.header)")] * takes_stamp
        self._read += [(owner, "str(m.header.frame_id)")] * takes_owner

    def add(self, row: Field, plain: Sequence[Field], reads_all: bool) -> None:
        """Add a field.

        Args:
            plain: all fields of the table.
            reads_all: also read fields that a function computes.
        """
        kind, name, what = row.kind, row.name, f"'{self._message}.{row.name}'"
        if kind == COUNT:
            letter = row.shape or ""
            sized, axis = next(
                (f, f.letters.index(letter)) for f in plain if f.kind != COUNT and letter in f.letters
            )
            self._written.append(f"{name}=size({self._value(sized)}, {axis})")
            self._reading.append(f"    {letter} = count(m.{name}, {what}, {MOST.get(letter, LONGEST)})")
            self._sizes.add(letter)
            return
        value, of_kind, names = self._value(row), self._named(kind), name.split()
        if isinstance(kind, Table):
            put = f"family.origin({{0}}) or {of_kind}.write({{0}}, family, frame_id)"
            written = f"[{put.format('item')} for item in {value}]" if row.shape else put.format(value)
            read = f"tuple(map({of_kind}.read, m.{name}))" if row.shape else f"{of_kind}.read(m.{name})"
            read += f" if m.{row.optional} else None" if row.optional else ""
        elif kind is str and row.shape:
            written, read = f"list({value} or ())", row.shape
            self._reading += [f"    {row.shape}_names = tuple(map(str, m.{name}))"]
            self._reading += [f"    {row.shape} = len({row.shape}_names)"]
            self._sizes.add(row.shape)
            read = f"{row.shape}_names"
        elif kind == TIME:
            written, read = f"family.time({value})", f"time_ns(m.{name})"
        elif row.shape is None:
            written, read = f"{of_kind}({value})", f"{of_kind}(m.{name})"
            if len(names) > 1:
                read = f"({', '.join(f'{of_kind}(m.{each})' for each in names)})"
        else:
            fixed = all(isinstance(size, int) for size in row.letters)
            written = f"{'fixed' if fixed else 'flat'}(family, {value}, {of_kind})"
            read = f"shaped(m.{name}, {what}, {self._shape(row.letters, f'len(m.{name})')})"
            read = read if row.own is None else f"array({read}, {self._named(row.own)})"
            read += f" if len(m.{name}) else None" if row.optional else ""
        if len(names) > 1:
            self._written += [f"{each}={of_kind}({value}[{k}])" for k, each in enumerate(names)]
        else:
            self._written.append(f"{name}={written}")
        if reads_all or row.optional or isinstance(row.of, str):
            self._read.append((row.key, read))

    def add_rows(self, rows: PersonRows, reads_all: bool) -> None:
        """Add an array of messages."""
        self._reading.append(f"    people = m.{rows.name}")
        made = []
        for row in rows.fields:
            name, kind, what = row.name, self._named(row.kind), f"'{rows.message}.{row.name}'"
            found, tail = f"[person.{name} for person in people]", row.letters[1:]
            if tail:
                self._before_writing.append(f"    {name} = rows({self._value(row)}, {kind}, count)")
                made.append(f"{name}=family.sequence({name}[k])")
                shape = self._shape(tail, f"len(people[0].{name}) if len(people) else 0")
                read = f"stacked({found}, {kind}, {what}, {shape})"
                flag = row.optional if isinstance(row.optional, str) else name
                read += f" if any(len(person.{flag}) for person in people) else None" if row.optional else ""
            else:
                self._before_writing.append(f"    {name} = asarray({self._value(row)}, {kind}).tolist()")
                made.append(f"{name}={name}[k]")
                read = f"numbers({found}, {kind}, {what})"
            if row is rows.fields[0]:
                self._before_writing.append(f"    count = len({name})")
            if reads_all or row.optional or isinstance(row.of, str):
                self._read.append((row.key, read))
        one = f"family.make('{rows.message}', {', '.join(made)})"
        self._written.append(f"{rows.name}=[{one} for k in range(count)]")

    def _named(self, thing: Any) -> str:
        """Register a type, table or function, and return its name in the source."""
        name = f"{getattr(thing, '__name__', 'table').strip('<>')}_{len(self._names)}"
        self._names[name] = thing
        return name

    def _value(self, row: Field) -> str:
        """Return the source expression of a field's value; None at run time if the record lacks the part."""
        if not isinstance(row.of, str):
            return f"{self._named(row.of)}(r)"
        part = row.key.partition(".")[0]
        value = f"r.{row.key}"
        return f"(None if r.{part} is None else {value})" if part in self._optional else value

    def _shape(self, letters: Sequence[str | int], length: str) -> str:
        """Return the sizes of a shape; the size of a new letter is computed from the array length."""
        new = [letter for letter in letters if isinstance(letter, str) and letter not in self._sizes]
        if new:
            known = " * ".join(str(size) for size in letters if size not in new) or "1"
            self._reading.append(f"    {new[0]} = rest({length}, {known}, {len(new)})")
            self._sizes.add(new[0])
        return ", ".join(map(str, letters))


def shaped(values: Any, what: str, *shape: int) -> Array:
    """Return a message's flat array in its shape.

    Raises:
        DataError: if it has another length, or holds a finite number beyond LARGEST.
    """
    array = np.asarray(values)
    if array.size != math.prod(shape):
        raise DataError(f"{what} has {array.size} values, expected {' x '.join(map(str, shape))}")
    if array.dtype.kind == "f":
        check_magnitude(what, array, LARGEST)
    return array.reshape(shape)


def _flat(family: MessageFamily, values: Any, kind: Any) -> Any:
    """Return an array as the value of a field of unbounded length; None becomes empty."""
    array = np.zeros(0, kind) if values is None else np.ascontiguousarray(values, kind)
    return family.sequence(array.reshape(-1))


def _fixed(family: MessageFamily, values: Any, kind: Any) -> Any:
    """Return an array as the value of a field of fixed length."""
    return np.array(values, kind).reshape(-1)


def _size(values: Array | None, axis: int) -> int:
    return 0 if values is None else int(values.shape[axis])


def _rows(values: Array | None, kind: Any, people: int) -> Array:
    """Return an array as (people, values of one person); None becomes empty."""
    array = np.zeros((people, 0), kind) if values is None else np.ascontiguousarray(values, kind)
    return array.reshape(people, math.prod(array.shape[1:]))


def _count(value: Any, what: str, most: int) -> int:
    """Return a size that a message states.

    Raises:
        DataError: if it is negative or above `most`.
    """
    count = int(value)
    if not 0 <= count <= most:
        raise DataError(f"{what} is {count}")
    return count


def _rest(length: int, known: int, times: int) -> int:
    """Return the size of an unknown dimension of an array.

    Args:
        length: number of values.
        known: product of the known sizes.
        times: how often the dimension occurs in the shape.
    """
    return round(float((length // max(known, 1)) ** (1 / times)))


def _stacked(found: list[Any], kind: Any, what: str, *shape: int) -> Array:
    """Stack the flat arrays of all people, and return one array (people, *shape).

    Raises:
        DataError: as `shaped`.
    """
    size = math.prod(shape)
    for each in found:
        if len(each) != size:
            shaped(each, what, *shape)
    together = np.concatenate(found) if found else np.zeros(0, kind)
    return shaped(together, what, len(found), *shape)


def _numbers(found: list[Any], kind: Any, what: str) -> Array:
    """Return one number per person as an array.

    Raises:
        DataError: if the type cannot hold a number.
    """
    try:
        return np.array(found, kind)
    except OverflowError:
        raise DataError(f"{what} is {max(found, key=abs)}, which is beyond {np.dtype(kind)}") from None


_HELPERS: Values = {  # helper functions by their names in the generated source
    "array": np.array,
    "asarray": np.asarray,
    "count": _count,
    "fixed": _fixed,
    "flat": _flat,
    "numbers": _numbers,
    "rest": _rest,
    "rows": _rows,
    "shaped": shaped,
    "size": _size,
    "stacked": _stacked,
    "stamp_of": stamp_of,
    "time_ns": time_ns,
}
