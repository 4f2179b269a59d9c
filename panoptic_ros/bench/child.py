"""Measurements in a fresh process of one thread: threads and memory of others do not count there."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import panoptic_ros
from panoptic_ros.errors import EnvironmentProblem, UserError

ONE_THREAD = {
    name: "1"
    for name in (
        "OMP_NUM_THREADS",
        "OPENBLAS_NUM_THREADS",
        "MKL_NUM_THREADS",
        "NUMBA_NUM_THREADS",
        "NUMEXPR_NUM_THREADS",
    )
} | {"XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"}


def run_child(module: str, request: dict[str, Any]) -> dict[str, Any]:
    """What `module` prints as JSON when it is run with the request as JSON on its standard input.

    Raises:
        UserError: if it answers with an "error".
        EnvironmentProblem: if it fails.
    """
    package = str(Path(panoptic_ros.__file__).parents[1])
    paths = [package, *filter(None, [os.environ.get("PYTHONPATH")])]
    done = subprocess.run(
        [sys.executable, "-m", module],
        input=json.dumps(request),
        text=True,
        capture_output=True,
        env={**os.environ, **ONE_THREAD, "PYTHONPATH": os.pathsep.join(paths)},
        check=False,
    )
    answer: dict[str, Any] = json.loads(answer_of(done, module))
    if "error" in answer:
        raise UserError(answer["error"])
    return answer


def answer_request(measure: Callable[[dict[str, Any]], dict[str, Any]]) -> None:
    """Answer the request on standard input; what the user can mend is part of the answer."""
    try:
        answer = measure(json.load(sys.stdin))
    except UserError as error:
        answer = {"error": str(error)}
    print(json.dumps(answer))


def answer_of(done: subprocess.CompletedProcess[str], name: str) -> str:
    """The standard output of a process that ended well.

    Raises:
        EnvironmentProblem: with the last line that it wrote, if it did not.
    """
    if done.returncode:
        last = done.stderr.strip().splitlines()[-1:] or [f"exit code {done.returncode}"]
        raise EnvironmentProblem(f"{name} failed: {last[0]}")
    return done.stdout
