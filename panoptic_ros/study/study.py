"""Base class of all studies, and the runner that serves them.

A study has options, cases, a measurement of each case, and columns of a table. It measures accuracy, time or
memory of this code next to baselines. `study.names` lists all studies. A new study is a subclass of `Study`
and a row of that list.
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
GAP = "  "  # between two columns of a table


@dataclass(frozen=True)
class Case:
    """One unit of work of a study.

    Args:
        title: text in the progress bar.
        request: input of `Study.measure`; its type depends on the study.
        cost: expected share of the time, relative to other cases.
    """

    title: str
    request: Any = None
    cost: float = 1.0


@dataclass(frozen=True)
class Column:
    """One column of the table.

    Args:
        key: Key of the value in a row.
        title: Title of the column.
        spec: Format of numbers, e.g. ".1f" or ".0%"; "" = text, or whole numbers.
        factor: Multiplier of the value, e.g. 1e3 from m to mm.
    """

    key: str
    title: str
    spec: str = ""
    factor: float = 1.0

    def cell(self, row: Mapping[str, Any]) -> str:
        """Return the text of a number, or of a pair (mean, half width); "-" = unknown."""
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
        name: Name of the study on the command line.
        options: Parsed options; see `add_options`.
        words: Options as typed on the command line, without those of the output.

    Attributes:
        columns: Columns of the table.
        across: Transpose the table, so that each row of the result becomes a column.
        over: Keys of the groups in which the table averages rows; empty = the table lists all rows.
        has_plot: True if `plot` draws the result.
    """

    columns: ClassVar[Sequence[Column]] = ()
    across: ClassVar[bool] = False
    over: ClassVar[Sequence[str]] = ()
    has_plot: ClassVar[bool] = False

    def __init__(self, name: str, options: argparse.Namespace, words: Sequence[str] = ()):
        self.name, self.options, self.words = name, options, list(words)

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """Add the options that this study accepts; the parser refuses all others."""

    def cases(self) -> Sequence[Case]:
        """Return the cases in the order of measurement.

        Raises:
            UsageError: on invalid options.
        """
        return (Case(self.name),)

    def measure(self, case: Case, progress: Progress) -> Iterable[Row]:
        """Return the rows of a case: numbers in SI units, or with the unit in the key."""
        raise NotImplementedError

    def summary(self, rows: list[Row]) -> Mapping[str, Any]:
        """Return figures over all rows; the JSON document has them next to the rows."""
        return {}

    def head(self, result: Result) -> str:
        """Return the lines above the table; "" = none."""
        return ""

    def lines(self, result: Result) -> Iterable[str]:
        """Return the lines of the text output: head and table."""
        rows = averaged(result["rows"], self.over) if self.over else result["rows"]
        head = self.head(result)
        return [*([*head.splitlines(), ""] if head else []), *table(rows, self.columns, self.across)]

    def plot(self, path: Path, result: Result) -> None:
        """Draw the result into a PNG file; called only if `has_plot` is True."""
        raise NotImplementedError


def run_study(study: Study, progress: Progress = untold) -> Result:
    """Measure all cases.

    Returns:
        document for JSON: the name, the options, the rows of all cases in their order, and the summary.

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
    """Measure several cases in parallel and return the rows of each case, in the order of the cases.

    It serves studies that run each case in a process of its own.
    """
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
    """Return one progress callback per part; the share of each part is proportional to its cost."""
    ends = [sum_ / sum(costs) for sum_ in accumulate(costs)]
    return [part_of(progress, begin, end) for begin, end in zip([0.0, *ends], ends)]


def table(rows: Sequence[Mapping[str, Any]], columns: Sequence[Column], across: bool = False) -> list[str]:
    """Return the lines of a table; text is left-aligned, numbers are right-aligned.

    Args:
        across: transpose the table, so that each row becomes a column.
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
    """Return one row per combination of key values: numbers as (mean, half width of 95 % interval)."""
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
    """Return the rows grouped by a key; the groups are in the order of their first row."""
    found: dict[Any, list[Row]] = {}
    for row in rows:
        found.setdefault(key(row), []).append(row)
    return found
