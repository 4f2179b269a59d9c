"""Parsers of values of options, for verbs and studies: each is a `type` of argparse."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from panoptic_ros.errors import UsageError


def output_file(text: str) -> Path:
    """Return a file to write, checked before any work; for `type` of an option.

    Raises:
        UsageError: if the text is empty.
        DataError, EnvironmentProblem: if nothing can be written there.
    """
    from panoptic_ros.io.files import check_output  # only now: --help must be quick

    if not text:
        raise UsageError("the name of the file to write is empty; name a file")
    check_output(Path(text))
    return Path(text)


def output_folder(text: str) -> Path:
    """Return a folder to write into, checked before any work; for `type` of an option.

    Raises:
        UsageError: if the text is empty.
        DataError, EnvironmentProblem: if nothing can be written there.
    """
    from panoptic_ros.io.files import check_output_folder

    if not text:
        raise UsageError("the name of the folder to write into is empty; name a folder")
    folder = check_output_folder(Path(text))
    return folder if Path(text).is_symlink() else Path(text)


def within(kind: type[int] | type[float], low: float, high: float) -> Callable[[str], Any]:
    """Return the parser of a number in a range."""

    def parse(text: str) -> float:
        try:
            value = kind(text)
        except ValueError:
            value = float("nan")
        if not low <= value <= high:
            whole = "whole number" if kind is int else "number"
            raise argparse.ArgumentTypeError(f"{text!r} is not a {whole} from {low:g} to {high:g}")
        return value

    return parse
