"""Command line options that several studies share.

Each value is parsed once. A bad value causes an error of one line.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from panoptic_ros.errors import UsageError

SETTING = "STAGE.NAME=VALUE"


def seeds(text: str) -> range:
    """Return the range of seeds for FROM:TO or for one seed N; use it as `type` of an option."""
    first, colon, last = text.partition(":")
    try:
        found = range(int(first), int(last) if colon else int(first) + 1)
    except ValueError:
        found = range(0)
    if not found or found.start < 0:
        raise argparse.ArgumentTypeError(f"{text!r}: write FROM:TO, e.g. 400:405, or one seed")
    return found


def numbers(low: int, high: int) -> Callable[[str], tuple[int, ...]]:
    """Return a parser of a list of integers from `low` to `high`; use it as `type` of an option."""

    def parse(text: str) -> tuple[int, ...]:
        try:
            found = tuple(int(word) for word in text.split(","))
        except ValueError:
            found = ()
        if not found or not all(low <= value <= high for value in found):
            raise argparse.ArgumentTypeError(
                f"{text!r} is not a list of whole numbers from {low} to {high}, e.g. {low + 1},{low + 2}"
            )
        return found

    return parse


def words(text: str) -> list[str]:
    """Return the words of a comma-separated list; use it as `type` of an option."""
    return [word.strip() for word in text.split(",") if word.strip()]


def add_cases(parser: argparse.ArgumentParser, cases: Iterable[str], others: Iterable[str] = ()) -> None:
    """Add the option --cases NAME,NAME.

    Args:
        cases: Names that are measured by default. others: Further names.
    """
    names, more = list(cases), ", ".join(others)
    parser.add_argument(
        "--cases",
        type=words,
        default=names,
        metavar="NAME,NAME",
        help=f"cases; default {','.join(names)}" + (f"; large ones: {more}" if more else ""),
    )


def add_seeds(parser: argparse.ArgumentParser, default: str) -> None:
    """Add the option --seeds FROM:TO."""
    parser.add_argument(
        "--seeds",
        type=seeds,
        default=seeds(default),
        metavar="FROM:TO",
        help=f"range of seeds of the simulation, or one seed; default {default}",
    )


def add_settings(
    parser: argparse.ArgumentParser, text: str = "one parameter, for every method", form: str = SETTING
) -> None:
    """Add the repeatable option --set, whose values have this form."""
    parser.add_argument(
        "--set", action="append", default=[], metavar=form, dest="settings", help=f"{text}; repeatable"
    )


def add_capture(parser: argparse.ArgumentParser, text: str, required: bool = True) -> None:
    """Add the options --capture DIR and --cameras NAME,NAME."""
    parser.add_argument("--capture", type=Path, metavar="DIR", required=required, help=text)
    parser.add_argument(
        "--cameras", type=words, default=[], metavar="NAME,NAME", help="use only these cameras of the capture"
    )


def add_recordings(parser: argparse.ArgumentParser) -> None:
    """Add the repeatable option --capture PATH..."""
    parser.add_argument(
        "--capture",
        nargs="+",
        action="append",
        default=[],
        metavar="PATH",
        dest="captures",
        help="recording with its truth: a folder (rig.json, detections.json.gz, truth.json.gz); or a bag "
        "(or folder) of `panoptic run` and TRUTH; or RIG DETECTIONS TRUTH. Repeatable",
    )


def recordings(options: argparse.Namespace) -> list[list[str]]:
    """Return the paths of each recording on the command line.

    Raises:
        UsageError: if a recording has more than three paths.
    """
    found: list[list[str]] = options.captures
    for paths in found:
        if len(paths) > 3:
            text = "give a folder, a bag and a truth, or three files"
            raise UsageError(f"--capture {' '.join(paths)}: {text}")
    return found


def known_names(given: list[str], known: Any, what: str) -> list[str]:
    """Return the given names unchanged after a check.

    Raises:
        UsageError: if a name is not in `known`.
    """
    for name in given:
        if name not in known:
            raise UsageError(f"there is no {what} {name!r}; there are {', '.join(known)}")
    return given
