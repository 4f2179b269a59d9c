"""Defines the finding of a check of `panoptic doctor`, and runs checks."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from panoptic_ros.errors import EnvironmentProblem

LEVELS = ("OK", "WARN", "FAIL")


@dataclass(frozen=True)
class Finding:
    """One line of the report.

    Args:
        level: OK, WARN (something works less well or is not there yet) or FAIL.
        found: The result of the check, with its value.
        remedy: Advice for the user; empty if all is well.
    """

    level: str
    found: str
    remedy: str = ""


Check = Callable[[], Finding]


def ok(found: str) -> Finding:
    """Return a finding without a problem."""
    return Finding("OK", found)


def warn(found: str, remedy: str) -> Finding:
    """Return a finding about something that works less well, or not yet."""
    return Finding("WARN", found, remedy)


def fail(found: str, remedy: str) -> Finding:
    """Return a finding about something that does not work."""
    return Finding("FAIL", found, remedy)


@dataclass(frozen=True)
class ChildResult:
    """Result of a piece of Python in a child process.

    Args:
        succeeded: whether the exit code was 0.
        output: its standard output.
        last_error: last line of its standard error; "" = none.
    """

    succeeded: bool
    output: str
    last_error: str


def start_python(code: str, *arguments: str) -> subprocess.Popen[str]:
    """Start a piece of Python in a child process, which isolates its imports and crashes."""
    return subprocess.Popen(
        [sys.executable, "-c", code, *arguments],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def finish(process: subprocess.Popen[str], timeout_s: float) -> ChildResult:
    """Wait for the process. Kill it after the timeout."""
    try:
        output, errors = process.communicate(timeout=timeout_s)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return ChildResult(False, "", f"no answer within {timeout_s:g} s")
    lines = [line.strip() for line in errors.splitlines() if line.strip()]
    last = lines[-1].split(". Please")[0] if lines else ""  # rclpy appends a long link
    return ChildResult(process.returncode == 0, output.strip(), last)


def run_checks(checks: Mapping[str, Check]) -> dict[str, Finding]:
    """Run all checks. A failed import or an unreachable resource becomes a finding, too."""
    findings = {}
    for name, check in checks.items():
        try:
            findings[name] = check()
        except ImportError as error:
            findings[name] = fail(f"cannot be loaded: {error}", "./run setup")
        except (EnvironmentProblem, OSError) as error:
            findings[name] = fail(str(error), "correct this first, then run the check again")
    return findings
