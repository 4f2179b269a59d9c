"""Entry point of the program: parse the arguments, call the verb, report errors, return the exit code."""

from __future__ import annotations

import argparse
import importlib
import keyword
import os
import sys
import warnings
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, NoReturn

import panoptic_ros
from panoptic_ros.errors import PanopticError, UsageError, one_line
from panoptic_ros.io.interruption import interrupted, listen_to_signals, settle
from panoptic_ros.io.kernel_cache import bad_path_told, full_disk_told

VERBS: dict[str, str] = {
    "run": "compute skeletons from cameras, videos, a capture folder or a bag, through ROS nodes",
    "view": "show results, a bag or the live graph in a page of any browser",
    "watch": "show the state of a live graph: nodes, rates, ages, latency, drops, warnings",
    "export": "write results or a bag as one HTML file with its images, to send to others",
    "solve": "compute skeletons from 2D people, without images and ROS",
    "simulate": "simulate a capture folder or 2D people with exact truth",
    "import": "convert a take of a public data set to a capture folder with its truth",
    "continuous": "compute motion as a function of time from cameras that are not synchronised",
    "kinematics": "solve bodies with joint angles from cameras and IMUs",
    "evaluate": "compare skeletons with the truth",
    "ltc": "decode or encode LTC timecode",
    "study": "measure accuracy, time and memory of this code beside baselines, in studies",
    "sync": "report the clocks of a capture, their faults and the remedies; match frames by clock",
    "calibrate": "calibrate cameras from recordings of a board",
    "rig": "check or convert a calibration",
    "record": "record a live graph to a self-contained bag, on all hosts at once",
    "replay": "replay a bag onto the live graph, from any stage's topic, at any rate",
    "bag": "repair an incomplete bag, or upgrade a bag of an older version",
    "bias": "measure the constant biases of a detector's joints against a reference",
    "prior": "train a pose prior from recorded motion",
    "models": "list, fetch and check pose models",
    "warm-up": "compile all kernels in advance, so that later commands start at once",
    "config": "show all parameters, or write the generated files",
    "doctor": "check what works on this machine, and name the remedy for each failure",
}

LONGEST_LINE = 2000  # characters of an error message; files can hold names of any length
# One BLAS thread: the matrices of all verbs are too small for more threads to help.
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the program.

    Returns:
        the exit code: 0, 2 for errors that the user can correct, 1 for faults of this program.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    if arguments[:1] == ["bench"]:  # command of old versions
        print(f"panoptic bench: it is now `panoptic study {_renamed(arguments[1:2])}`", file=sys.stderr)
        return 2
    verb = next((word for word in arguments if word in VERBS), "")
    name = f"panoptic {verb}".strip()
    try:
        args = _parser(verb).parse_args(arguments)
        with full_disk_told(), bad_path_told():
            return int(_module(args.verb).run(args) or 0)
    except BrokenPipeError:  # the reader of our output has ended, e.g. `| head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (Exception, KeyboardInterrupt) as error:
        # libraries convert a KeyboardInterrupt into errors of their own
        if interrupted() or isinstance(error, KeyboardInterrupt):
            settle()
            print(f"{name}: interrupted", file=sys.stderr)
            return 2
        if not isinstance(error, PanopticError):
            raise
        print(f"{name}: {one_line(error, LONGEST_LINE)}", file=sys.stderr)
        return error.exit_code


def _renamed(bench: Sequence[str]) -> str:
    """Return the name of the study that replaced an old bench."""
    name = bench[0] if bench else "NAME"
    return {"kinematics": "kinematics-time"}.get(name, name)


def _tell_warning(message: Warning | str, *about: object, **more: object) -> None:
    """Print a Python warning in one line; see `warnings.showwarning`."""
    print(f"warning: {message}", file=sys.stderr)


def _module(verb: str) -> Any:
    name = verb.replace("-", "_") + "_" * keyword.iskeyword(verb)
    return importlib.import_module(f"panoptic_ros.cli.{name}")


class _ArgumentParser(argparse.ArgumentParser):
    """Argument parser that reports wrong arguments in one line, like all other errors."""

    def error(self, message: str) -> NoReturn:
        """Raise a UsageError; see `argparse`.

        Raises:
            UsageError: always.
        """
        raise UsageError(f"{message}; see `{self.prog} --help`")


def _parser(chosen: str) -> argparse.ArgumentParser:
    """Return the argument parser; only the chosen verb is imported, so that --help is fast."""
    parser = _ArgumentParser(prog="panoptic", description="Online multi-view, multi-person 3D pose.")
    parser.add_argument("--version", action="version", version=f"panoptic {panoptic_ros.__version__}")
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", required=True)
    for verb, text in VERBS.items():
        sub = verbs.add_parser(verb, help=text, description=text[0].upper() + text[1:] + ".")
        if verb == chosen:
            _module(verb).add_arguments(sub)
    return parser


def program() -> NoReturn:
    """Run the installed program.

    It exits without a shutdown of the interpreter, which takes half a second. After an interruption of code
    run by exec(), the shutdown would also lose our exit code and kill the process with the signal.
    """
    listen_to_signals()
    warnings.showwarning = _tell_warning
    for name in ONE_THREAD:
        os.environ.setdefault(name, "1")
    code = main()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # the reader of the stream has ended
            stream.flush()
    os._exit(code)


if __name__ == "__main__":
    program()
