"""Checks that records run on their contents."""

from __future__ import annotations

from functools import cache
from typing import Any, TypeVar

import numpy as np

from panoptic_ros.errors import DataError, one_line, shown

Array = np.ndarray
Record = TypeVar("Record")
NOT_GIVEN: Any = None  # default of a record's field that `__post_init__` replaces


def known_good(kind: type[Record], values: dict[str, Any]) -> Record:
    """Return a record without running its checks, for callers whose contents always pass them.

    Args:
        kind: Class of the record.
        values: All fields, in the form that the record holds. Arrays become read-only and are not copied.
    """
    record = object.__new__(kind)
    for name, value in values.items():
        if type(value) is np.ndarray:
            value.flags.writeable = False
        object.__setattr__(record, name, value)
    return record


class ShapeChecks:
    """Shape checks of one record's arrays against letters: equal letters are equal sizes."""

    def __init__(self, record: Any):
        self.record = record
        self.sizes: dict[str, int] = {}

    def store(self, name: str, dtype: Any, letters: str) -> Array:
        """Replace attribute `name` by a read-only copy with that dtype and shape, e.g. "P J 2".

        Raises:
            DataError: naming the record, the attribute and both shapes.
        """
        value = getattr(self.record, name)
        try:
            array = own_copy(value, dtype)
        except (TypeError, ValueError, OverflowError) as error:
            told = one_line(error)
            raise DataError(f"{self._of(name)} is not an array of {np.dtype(dtype)}: {told}") from None
        wanted = _letters(letters)
        if array.ndim != len(wanted):
            raise DataError(f"{self._of(name)} has shape {array.shape}, expected ({letters})")
        for letter, size in zip(wanted, array.shape):
            known = letter if isinstance(letter, int) else self.sizes.setdefault(letter, size)
            if known != size:
                raise DataError(
                    f"{self._of(name)} has shape {array.shape}, expected ({letters}) with {letter} = {known}"
                )
        object.__setattr__(self.record, name, array)
        return array

    def _of(self, name: str) -> str:
        return f"{type(self.record).__name__}.{name}"


def own_copy(value: Any, dtype: Any = None) -> Array:
    """Return a read-only array of this dtype (None = its own): a copy, unless the value is read-only."""
    if (
        type(value) is np.ndarray
        and dtype in (None, value.dtype)
        and value.base is None
        and value.flags.c_contiguous
        and not value.flags.writeable
    ):
        return value
    array = np.array(value, dtype=dtype, order="C")
    array.setflags(write=False)
    return array


@cache
def _letters(text: str) -> tuple[str | int, ...]:
    """Return the sizes in "P J 2": letters as text, numbers as ints."""
    return tuple(int(letter) if letter.isdigit() else letter for letter in text.split())


def check_scores(record: Any, name: str, scores: Array) -> None:
    """Check that scores are in [0, 1].

    Raises:
        DataError: otherwise.
    """
    if scores.size and not (scores.min() >= 0.0 and scores.max() <= 1.0):
        wrong = scores.ravel()[int(np.argmax(~((scores >= 0.0) & (scores <= 1.0))))]
        raise DataError(
            f"{type(record).__name__}.{name} has the score {wrong:g}, outside of 0..1; scale scores to 0..1"
        )


def check_missing(record: Any, name: str, values: Array, scores: Array) -> None:
    """Check that values (..., k) are finite where scores (...) are positive, and nowhere infinite.

    Raises:
        DataError: otherwise.
    """
    finite = np.isfinite(values).all(-1)
    if not finite[scores > 0.0].all():
        raise DataError(f"{type(record).__name__}.{name} is not finite although its score is positive")
    check_not_infinite(record, name)


def check_magnitude(what: str, values: Array, limit: float, unit: str = "") -> None:
    """Check that no finite value exceeds what can be measured: its square would spoil later results.

    Raises:
        DataError: naming the largest value and the limit.
    """
    if values.dtype.kind == "f" and np.vdot(values, values) <= limit * limit:
        return  # the usual case: faster than finding the largest value; False for NaN
    if values.size and max(-np.fmin.reduce(values, None), np.fmax.reduce(values, None)) > limit:
        largest = float(np.abs(np.where(np.isfinite(values), values, 0.0)).max())
        if largest > limit:
            held = f"{largest:.3g} {unit}".rstrip()
            raise DataError(f"{what} holds {held}; at most {limit:g} is possible")


def check_not_infinite(record: Any, names: str) -> None:
    """Check that values are finite, or NaN where unknown.

    Raises:
        DataError: otherwise.
    """
    for name in names.split():
        if np.isinf(getattr(record, name)).any():
            raise DataError(f"{type(record).__name__}.{name} is infinite")


def check_stamp(record: Any, stamp_ns: Any, name: str = "stamp_ns") -> int:
    """Return a timestamp as int, after checking that it is a non-negative int of ns below 2**63.

    Raises:
        DataError: otherwise.
    """
    if isinstance(stamp_ns, bool) or not isinstance(stamp_ns, (int, np.integer)):
        raise DataError(f"{type(record).__name__}.{name} = {shown(stamp_ns)} is not an int of nanoseconds")
    if not 0 <= stamp_ns < 2**63:
        raise DataError(f"{type(record).__name__}.{name} = {stamp_ns} is out of range")
    return int(stamp_ns)
