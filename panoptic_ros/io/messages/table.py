"""One table of fields for each message: how a record is written as it, and read and checked again.

A table says for every field of the message what it holds and where in the record that is. Sizes are letters:
equal letters are equal sizes, as in `domain.checks.Shapes`. A table becomes the source of two functions, as
somebody would write them by hand, so that a message costs little more than its arrays:

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
from panoptic_ros.io.messages.family import Messages, stamp_of, time_ns

Array = np.ndarray
Values = dict[str, Any]  # of a record: by attribute, with a dot for what a part of it holds
Getter = Callable[[Any], Any]
COUNT, TIME = "count", "time"  # kinds of fields: the size of a letter, and a stamp, int ns
LONGEST = 2**24  # of one dimension, also where another one is 0
MOST = {"J": 4096}  # by letter: no body has more joints
LARGEST = 1e12  # m, px, s: nobody means more, and squares of much more spoil what they are added to


@dataclass(frozen=True)
class Field:
    """One field of a message.

    Args:
        name: in the message. "a b" are two fields for a pair in the record.
        kind: of its values: int, float, bool, str, a numpy type of an array, `TIME`, `COUNT`, or the `Table`
            of a message that it holds.
        shape: letters and numbers of an array; a single letter of names and messages; the letter of a
            `COUNT`; None: a scalar. The size of a letter that no field before has set follows from the
            length.
        of: attribute of the record, "" = `name`; "part.attribute" of what the record holds. A function
            computes it: it is written only, and read for `Table.complete` alone, or where it is optional.
        own: type of the array in the record, for records that keep arrays as they are.
        optional: None in the record is empty in the message. A name: of the field of the message that says
            whether this one is there, by what it is or by its length.
    """

    name: str
    kind: Any
    shape: str | None = None
    of: str | Getter = ""
    own: Any = None
    optional: bool | str = False

    @property
    def key(self) -> str:
        """The attribute of the record."""
        return self.of if isinstance(self.of, str) and self.of else self.name

    @property
    def letters(self) -> tuple[str | int, ...]:
        """The sizes of the shape."""
        return tuple(int(size) if size.isdigit() else size for size in (self.shape or "").split())


@dataclass(frozen=True)
class Rows:
    """An array of messages, one for every person, whose values are arrays of all people in the record.

    Args:
        name, message: of the field, and of what it holds.
        fields: shapes begin with the letter of the people; without more they are scalars.
    """

    name: str
    message: str
    fields: tuple[Field, ...]


class Table:
    """How a record is written as a message.

    Args:
        message: name. record: class.
        header: attributes with the stamp (int ns) and with the owner in the header of the message; "" = 0,
            and the world frame. None: it has none.
        parts: of the record, by attribute: class, and whether it is None where its first value is empty.
        complete: changes what was read before the record is made, and checks it.
    """

    def __init__(
        self,
        message: str,
        record: type,
        header: tuple[str, str] | None,
        fields: tuple[Field | Rows, ...],
        parts: dict[str, tuple[type, bool]] | None = None,
        complete: Callable[[Values], None] | None = None,
    ):
        self.message, self.record, self.header, self.fields = message, record, header, fields
        self._parts, self._complete = parts or {}, complete
        source = _Source(message, {part for part, (_, optional) in self._parts.items() if optional})
        known = {field.name for field in dataclasses.fields(record)}
        source.add_header([(name, name in known) for name in header or ()])
        plain = [f for row in fields for f in (row.fields if isinstance(row, Rows) else (row,))]
        for row in fields:
            if isinstance(row, Rows):
                source.add_rows(row, complete is not None)
            else:
                source.add(row, plain, complete is not None)
        self.write: Callable[[Any, Messages, str], Any]
        self.write, self._values_of = source.compiled(record, self._parts, complete is not None)

    def read(self, message: Any) -> Any:
        """The record of a message.

        Raises:
            DataError: if arrays do not fit each other, or hold what cannot be.
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
    """Source of the two functions of a table.

    Args:
        optional: parts of the record that can be None.
    """

    def __init__(self, message: str, optional: Collection[str]):
        self._message, self._optional = message, optional
        self._names: Values = dict(_HELPERS)
        self._before_writing: list[str] = []
        self._written: list[str] = []  # field=expression
        self._reading: list[str] = []
        self._read: list[tuple[str, str]] = []  # attribute, expression
        self._sizes: set[str] = set()

    def compiled(
        self, record: type, parts: dict[str, tuple[type, bool]], gives_values: bool
    ) -> tuple[Callable[..., Any], Callable[..., Any]]:
        """What makes the message of a record, and the record (or its values) of a message."""
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
        """Attributes with the stamp and the owner, and whether the record is made of them."""
        if not names:
            return
        (stamp, takes_stamp), (owner, takes_owner) = names
        written = f"family.header({f'r.{stamp}' if stamp else 0}, {f'r.{owner}' if owner else 'frame_id'})"
        self._written.append(f"header={written}")
        self._read += [(stamp, "stamp_of(m.header)")] * takes_stamp
        self._read += [(owner, "str(m.header.frame_id)")] * takes_owner

    def add(self, row: Field, plain: Sequence[Field], reads_all: bool) -> None:
        """A field.

        Args:
            plain: all fields of the table. reads_all: also those that are computed.
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

    def add_rows(self, rows: Rows, reads_all: bool) -> None:
        """An array of messages."""
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
        """The name by which the source knows a type, a table or a function."""
        name = f"{getattr(thing, '__name__', 'table').strip('<>')}_{len(self._names)}"
        self._names[name] = thing
        return name

    def _value(self, row: Field) -> str:
        """What takes the value of a field from a record; None where the part that has it is not there."""
        if not isinstance(row.of, str):
            return f"{self._named(row.of)}(r)"
        part = row.key.partition(".")[0]
        value = f"r.{row.key}"
        return f"(None if r.{part} is None else {value})" if part in self._optional else value

    def _shape(self, letters: Sequence[str | int], length: str) -> str:
        """Sizes by letters; that of one that is not known yet follows from the length of the array."""
        new = [letter for letter in letters if isinstance(letter, str) and letter not in self._sizes]
        if new:
            known = " * ".join(str(size) for size in letters if size not in new) or "1"
            self._reading.append(f"    {new[0]} = rest({length}, {known}, {len(new)})")
            self._sizes.add(new[0])
        return ", ".join(map(str, letters))


def shaped(values: Any, what: str, *shape: int) -> Array:
    """A message's flat array in its shape.

    Raises:
        DataError: if it has another length, or holds finite numbers that are beyond all measure.
    """
    array = np.asarray(values)
    if array.size != math.prod(shape):
        raise DataError(f"{what} has {array.size} values, expected {' x '.join(map(str, shape))}")
    if array.dtype.kind == "f":
        check_magnitude(what, array, LARGEST)
    return array.reshape(shape)


def _flat(family: Messages, values: Any, kind: Any) -> Any:
    """What a field of unbounded length takes of an array; None is empty."""
    array = np.zeros(0, kind) if values is None else np.ascontiguousarray(values, kind)
    return family.sequence(array.reshape(-1))


def _fixed(family: Messages, values: Any, kind: Any) -> Any:
    """What a field of fixed length takes of an array."""
    return np.array(values, kind).reshape(-1)


def _size(values: Array | None, axis: int) -> int:
    return 0 if values is None else int(values.shape[axis])


def _rows(values: Array | None, kind: Any, people: int) -> Array:
    """An array with the people in front, flat for everybody."""
    array = np.zeros((people, 0), kind) if values is None else np.ascontiguousarray(values, kind)
    return array.reshape(people, math.prod(array.shape[1:]))


def _count(value: Any, what: str, most: int) -> int:
    """A size that a message states.

    Raises:
        DataError: if nothing has it.
    """
    count = int(value)
    if not 0 <= count <= most:
        raise DataError(f"{what} is {count}")
    return count


def _rest(length: int, known: int, times: int) -> int:
    """The size of an array of that length behind the known ones, where it stands so many times."""
    return round(float((length // max(known, 1)) ** (1 / times)))


def _stacked(found: list[Any], kind: Any, what: str, *shape: int) -> Array:
    """An array of all people from those of each.

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
    """A number of every person.

    Raises:
        DataError: if the type does not hold one.
    """
    try:
        return np.array(found, kind)
    except OverflowError:
        raise DataError(f"{what} is {max(found, key=abs)}, which is beyond {np.dtype(kind)}") from None


_HELPERS: Values = {  # by the names that sources know
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
