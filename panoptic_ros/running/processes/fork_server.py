"""A process that has loaded everything, and forks nodes on demand: a successor is there at once.

`python -m panoptic_ros.running.processes.fork_server LAUNCH_FILE` reads "NAME<TAB>LOG" from its standard
input and writes "ready", "forked NAME PID" and "ended PID CODE" to its standard output. It ends when its
input does, and its children with it.
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

TASK_OF = {"voting": "votes"}  # what loads the kernels of a stage, where it is not called like it
LOOK_S = 0.05
NICE = 10  # while it loads, beside processes that start


def main() -> int:
    """Load, then serve until the input ends."""
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
    gc.freeze()  # what is there is shared with children as long as nobody writes to it
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
    """Import nodes and stages, and load the kernels that stages of this launch file need; in a thread of its
    own, as only a thread can be less urgent than the processes that start beside it, and forget it later.
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
