"""Functions applied to all arrays of a record of named fields, also of nested records; rows are people."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

Array = np.ndarray
Record = TypeVar("Record", bound=tuple[Any, ...])


def of_all(function: Callable[..., Array], record: Record, *others: Record) -> Record:
    """Return the record with a function applied to each of its arrays, and to the same arrays of `others`."""

    def one(value: Any, *more: Any) -> Any:
        if isinstance(value, tuple):
            return of_all(function, value, *more)
        return function(value, *more) if isinstance(value, np.ndarray) else value

    return type(record)(*map(one, record, *others))


def selected(record: Record, rows: Array) -> Record:
    """Return the people with these rows."""
    return of_all(lambda array: array[rows], record)


def joined(record: Record, more: Record) -> Record:
    """Return the people of both records, those of the first one first."""
    return of_all(lambda *arrays: np.concatenate(arrays), record, more)
