"""Parsers of option values for verbs and studies. Each serves as the `type` of an argparse option."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from panoptic_ros.errors import UsageError


def output_file(text: str) -> Path:
    """Return the path of an output file after checking that it can be written.

    Use it as the `type` of an option, so that the check precedes any work.

    Raises:
        UsageError: if the text is empty.
        DataError, EnvironmentProblem: if nothing can be written there.
    """
    from panoptic_ros.io.files import check_output  # imported here to keep --help fast

    if not text:
        raise UsageError("the name of the file to write is empty; name a file")
    check_output(Path(text))
    return Path(text)


def output_folder(text: str) -> Path:
    """Return the path of an output folder after checking that files can be written into it.

    Use it as the `type` of an option, so that the check precedes any work.

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
    """Return a parser that accepts numbers from `low` to `high`."""

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


def camera_distance(text: str) -> tuple[str, str, float]:
    """Return two cameras and their distance, m, of CAM_A,CAM_B=METRES; for `type=` of argparse.

    Raises:
        ArgumentTypeError: if the text is different, or the distance is not 0.01 to 1000 m.
    """
    names, _, metres = text.partition("=")
    first, _, second = names.partition(",")
    try:
        found = float(metres)
    except ValueError:
        found = 0.0
    if not (first and second and first != second and 0.01 <= found <= 1000.0):
        raise argparse.ArgumentTypeError(f"{text!r}: write CAM_A,CAM_B=METRES, e.g. cam0,cam1=3.42")
    return first, second, found
