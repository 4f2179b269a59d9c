"""Run measurements in a fresh process with one thread.

Threads and memory of other code do not count there.
"""

from __future__ import annotations

import importlib
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


def run_child(function: Callable[..., Any], request: dict[str, Any]) -> Any:
    """Call a function in a child process and return its answer.

    The child process imports the module of the function. Request and answer are JSON.

    Raises:
        UserError: if the function raises one in the child process.
        EnvironmentProblem: if the child process fails.
    """
    package = str(Path(panoptic_ros.__file__).parents[1])
    paths = [package, *filter(None, [os.environ.get("PYTHONPATH")])]
    done = subprocess.run(
        [sys.executable, "-m", __name__, f"{function.__module__}:{function.__name__}"],
        input=json.dumps(request),
        text=True,
        capture_output=True,
        env={**os.environ, **ONE_THREAD, "PYTHONPATH": os.pathsep.join(paths)},
        check=False,
    )
    answer: dict[str, Any] = json.loads(answer_of(done, function.__module__))
    if "error" in answer:
        raise UserError(answer["error"])
    return answer["answer"]


def answer_request(name: str) -> None:
    """Call MODULE:FUNCTION with the request on standard input and print its answer as JSON.

    A `UserError` of the function becomes the answer {"error": message}.
    """
    module, _, function = name.partition(":")
    try:
        answer = {"answer": getattr(importlib.import_module(module), function)(json.load(sys.stdin))}
    except UserError as error:
        answer = {"error": str(error)}
    print(json.dumps(answer))


def answer_of(done: subprocess.CompletedProcess[str], name: str) -> str:
    """Return the standard output of a process that exited with code 0.

    Raises:
        EnvironmentProblem: on any other exit code, with the last line that the process wrote to standard
            error.
    """
    if done.returncode:
        last = done.stderr.strip().splitlines()[-1:] or [f"exit code {done.returncode}"]
        raise EnvironmentProblem(f"{name} failed: {last[0]}")
    return done.stdout


if __name__ == "__main__":
    answer_request(sys.argv[1])
