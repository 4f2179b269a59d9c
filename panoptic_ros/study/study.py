"""A study: options, cases, a measurement of each case, columns of a table. One runner serves all studies.

A study measures accuracy, time or memory of this code beside baselines. `study.names` lists all studies.
A new study is a subclass of `Study` and a row of that list.
"""

from __future__ import annotations

import argparse
import math
import numbers
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from scipy.stats import t as student

from panoptic_ros.stage import Progress, part_of, untold

Row = dict[str, Any]
Result = dict[str, Any]
CONFIDENCE = 0.95
GAP = "  "  # between two columns


@dataclass(frozen=True)
class Case:
    """One unit of work of a study.

    Args:
        title: for the progress bar.
        request: what `Study.measure` needs to know; the study decides its type.
        cost: expected share of the time, relative to other cases.
    """

    title: str
    request: Any = None
    cost: float = 1.0


@dataclass(frozen=True)
class Column:
    """One column of the table.

    Args:
        key: of a row.
        title: of the column.
        spec: format of numbers, e.g. ".1f" or ".0%"; "" = text, or whole numbers.
        factor: of the value, e.g. 1e3 from m to mm.
    """

    key: str
    title: str
    spec: str = ""
    factor: float = 1.0

    def cell(self, row: Mapping[str, Any]) -> str:
        """Return the text of a value, or of a pair of a mean and its half width; "-" = not known."""
        value = row.get(self.key)
        if isinstance(value, tuple):
            mean, half = value
            text = self._text(mean)
            return text if text == "-" or not math.isfinite(half) else f"{text} ±{self._text(half)}"
        return self._text(value)

    def _text(self, value: Any) -> str:
        if value is None or (_is_number(value) and not math.isfinite(value)):
            return "-"
        if not _is_number(value):
            return str(value)
        if not self.spec:
            return f"{value:.4g}" if isinstance(value, float) else str(value)
        return format(self.factor * value, self.spec)


class Study:
    """Base class of all studies.

    Args:
        name: as the user writes it.
        options: parsed options; see `add_options`.
        words: the options as the user wrote them, without those of the output.

    Attributes:
        columns: of the table.
        across: each row of the result is a column of the table.
        over: keys by which the table averages rows, e.g. over seeds; empty = the table shows all rows.
        has_plot: whether `plot` draws the result.
    """

    columns: ClassVar[Sequence[Column]] = ()
    across: ClassVar[bool] = False
    over: ClassVar[Sequence[str]] = ()
    has_plot: ClassVar[bool] = False

    def __init__(self, name: str, options: argparse.Namespace, words: Sequence[str] = ()):
        self.name, self.options, self.words = name, options, list(words)

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """Add the options that this study understands; all others are refused."""

    def cases(self) -> Sequence[Case]:
        """Return the cases in the order in which they are measured.

        Raises:
            UsageError: on options that make no sense.
        """
        return (Case(self.name),)

    def measure(self, case: Case, progress: Progress) -> Iterable[Row]:
        """Return the rows of a case: numbers in SI units or with the unit in the key."""
        raise NotImplementedError

    def summary(self, rows: list[Row]) -> Mapping[str, Any]:
        """Return figures of all rows together, for JSON beside the rows."""
        return {}

    def head(self, result: Result) -> str:
        """Return the line above the table; "" = none."""
        return ""

    def lines(self, result: Result) -> Iterable[str]:
        """Return the text for people."""
        rows = averaged(result["rows"], self.over) if self.over else result["rows"]
        head = self.head(result)
        return [*([head, ""] if head else []), *table(rows, self.columns, self.across)]

    def plot(self, path: Path, result: Result) -> None:
        """Draw the result as PNG; only where `has_plot`."""
        raise NotImplementedError


def run_study(study: Study, progress: Progress = untold) -> Result:
    """Measure all cases.

    Returns:
        for JSON: the name, the options, the rows of all cases in their order, and the summary.

    Raises:
        UserError: as `Study.cases` and `Study.measure`.
    """
    cases, at_once = study.cases(), getattr(study.options, "jobs", 1)
    if at_once > 1:
        found = _at_once(study, cases, at_once, progress)
    else:
        parts = shared_out(progress, [case.cost for case in cases])
        found = [list(study.measure(case, _titled(case.title, part))) for case, part in zip(cases, parts)]
    progress(1.0, "")
    rows = [row for own in found for row in own]
    return {"study": study.name, "options": study.words, "rows": rows, **study.summary(rows)}


def _at_once(study: Study, cases: Sequence[Case], at_once: int, progress: Progress) -> list[list[Row]]:
    """Measure several cases at a time, for studies whose cases are processes; their rows in order."""
    whole, done = sum(case.cost for case in cases), 0.0
    with ThreadPoolExecutor(at_once) as pool:
        running = {pool.submit(lambda case: list(study.measure(case, untold)), case): case for case in cases}
        try:
            for future in as_completed(running):
                future.result()
                done += running[future].cost
                progress(min(1.0, done / whole), running[future].title)
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
        return [future.result() for future in running]


def _titled(title: str, progress: Progress) -> Progress:
    progress(0.0, title)
    return lambda share, doing: progress(share, f"{title}: {doing}" if doing else title)


def shared_out(progress: Progress, costs: Sequence[float]) -> list[Progress]:
    """Return the progress of each of several parts, whose shares of the whole are as their costs."""
    ends = [sum_ / sum(costs) for sum_ in accumulate(costs)]
    return [part_of(progress, begin, end) for begin, end in zip([0.0, *ends], ends)]


def table(rows: Sequence[Mapping[str, Any]], columns: Sequence[Column], across: bool = False) -> list[str]:
    """Return the lines of a table: text is left-aligned, numbers are right-aligned.

    Args:
        across: each row is a column of the table.
    """
    grid = [[column.title for column in columns], *([c.cell(row) for c in columns] for row in rows)]
    if across:
        grid = [list(line) for line in zip(*grid)]
    left = [across or not any(_is_figure(row.get(c.key)) for row in rows) for c in columns]
    widths = [max(map(len, column)) for column in zip(*grid)]
    return [
        GAP.join(
            f"{cell:<{width}}" if (k == 0 if across else left[k]) else f"{cell:>{width}}"
            for k, (cell, width) in enumerate(zip(line, widths))
        ).rstrip()
        for line in grid
    ]


def _is_number(value: Any) -> bool:
    return isinstance(value, numbers.Real) and not isinstance(value, bool)


def _is_figure(value: Any) -> bool:
    return _is_number(value) or isinstance(value, tuple)


def averaged(rows: Sequence[Row], keys: Sequence[str]) -> list[Row]:
    """Return a row for each combination of the keys' values: numbers as (mean, half width of 95 %)."""
    groups: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(row[key] for key in keys), []).append(row)
    return [
        dict(zip(keys, values))
        | {
            name: mean_and_width([row[name] for row in own])
            for name in own[0]
            if name not in keys and any(_is_number(row[name]) for row in own)
        }
        | {"samples": len(own)}
        for values, own in groups.items()
    ]


def mean_and_width(values: Sequence[float | None]) -> tuple[float, float]:
    """Return the mean of the finite values and the half width of its confidence interval (Student's t).

    The half width of fewer than two values is NaN.
    """
    known = np.array([v for v in values if v is not None and math.isfinite(v)], float)
    if not len(known):
        return math.nan, math.nan
    if len(known) < 2:
        return float(known[0]), math.nan
    width = student.ppf(0.5 + 0.5 * CONFIDENCE, len(known) - 1) * known.std(ddof=1) / math.sqrt(len(known))
    return float(known.mean()), float(width)


def grouped(rows: Iterable[Row], key: Callable[[Row], Any]) -> dict[Any, list[Row]]:
    """Return the rows by a key, in the order of their first appearance."""
    found: dict[Any, list[Row]] = {}
    for row in rows:
        found.setdefault(key(row), []).append(row)
    return found
