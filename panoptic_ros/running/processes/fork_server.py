"""Runs the fork server: a process that loads all modules once, then forks nodes on demand without delay.

`python -m panoptic_ros.running.processes.fork_server LAUNCH_FILE` reads "NAME<TAB>LOG" from its standard
input. It writes "ready", "forked NAME PID" and "ended PID CODE" to its standard output. The server ends when
its input ends, and its children end with it.
"""

from __future__ import annotations

import gc
import importlib
import json
import os
import selectors
import sys
import threading
import traceback
from contextlib import redirect_stdout
from pathlib import Path
from typing import TextIO

from panoptic_ros.io.output import print_to
from panoptic_ros.running.compiling.kernel_tasks import TASKS

# compile task that loads a stage's kernels, where its name differs from the stage's name
TASK_OF = {"voting": "votes"}
LOOK_S = 0.05
NICE = 10  # niceness while kernels are loaded, as other processes start at the same time


def main() -> int:
    """Load all modules, then serve requests until the input ends."""
    launch_file = sys.argv[1]
    told = os.fdopen(os.dup(1), "w", buffering=1)
    faults: list[BaseException] = []
    loading = threading.Thread(target=_load, args=(launch_file, faults))
    with redirect_stdout(sys.stderr):
        loading.start()
        loading.join()
    if faults:
        raise faults[0]
    gc.collect()
    gc.freeze()  # the current objects stay shared with the children as long as no process writes to them
    told.write("ready\n")
    waiting = selectors.DefaultSelector()
    waiting.register(sys.stdin, selectors.EVENT_READ)
    while True:
        if waiting.select(LOOK_S):
            line = sys.stdin.readline()
            if not line:
                return 0
            name, log = line.rstrip("\n").split("\t")
            told.write(f"forked {name} {_fork(launch_file, name, log)}\n")
        _tell_of_ended(told)


def _load(launch_file: str, faults: list[BaseException]) -> None:
    """Import nodes and stages, and load the kernels that the stages of this launch file need.

    This runs in its own thread, at a lower priority than the processes that start beside it. The main thread
    keeps its normal priority.

    Args:
        faults: receives an exception, if one occurs.
    """
    os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICE)
    try:
        importlib.import_module("panoptic_ros.nodes.main")  # needs ROS
        document = json.loads(Path(launch_file).read_text())
        entries = [entry for process in document["processes"].values() for entry in process]
        stages = {stage for entry in entries for stage in entry.get("stages", ())}
        for stage in sorted(stages):
            task = TASK_OF.get(stage, stage)
            if task in TASKS:
                TASKS[task]()
    except BaseException as error:
        faults.append(error)


def _fork(launch_file: str, name: str, log: str) -> int:
    server = os.getpid()
    pid = os.fork()
    if pid:
        return pid
    code = 1
    try:
        os.setsid()
        print_to(log)
        code = sys.modules["panoptic_ros.nodes.main"].host([launch_file, name, str(server)])
    except BaseException:
        traceback.print_exc()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def _tell_of_ended(told: TextIO) -> None:
    while True:
        try:
            pid, status = os.waitpid(-1, os.WNOHANG)
        except ChildProcessError:
            return
        if not pid:
            return
        told.write(f"ended {pid} {os.waitstatus_to_exitcode(status)}\n")


if __name__ == "__main__":
    os._exit(main())
