"""Commands in children of a process of its own, which has no threads: one JSON request and answer a line.

A request is {"words": [...], "folder": ..., "told": file}, the answer {"code", "memory", "cpu_s"}.
"""

import io
import json
import os
import resource
import sys
import traceback
from pathlib import Path

# imported here, as every child would import them
from panoptic_ros.cli import kinematics, rig, simulate, solve  # noqa: F401
from panoptic_ros.cli.main import main
from panoptic_ros.cli.run import beginning, source, watch  # noqa: F401
from panoptic_ros.running import solve as _solve  # noqa: F401
from panoptic_ros.running.plans import rig_files  # noqa: F401
from panoptic_ros.running.runs import run as _run  # noqa: F401

RUNAWAY = 16 << 30  # bytes of addresses


def child(words, folder, told):
    """Run a command, and end the process with its exit code."""
    code = 99
    try:
        os.dup2(os.open(told, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 2)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        sys.stdout, sys.stderr = io.StringIO(), os.fdopen(2, "w", buffering=1)
        os.chdir(folder)
        resource.setrlimit(resource.RLIMIT_AS, (RUNAWAY, RUNAWAY))
        code = main(words)
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stderr.flush()
        os._exit(code)


def serve():
    for line in sys.stdin:
        request = json.loads(line)
        pid = os.fork()
        if pid == 0:
            child(**request)
        before = int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()
        _, status, usage = os.wait4(pid, 0)
        answer = {
            "code": os.waitstatus_to_exitcode(status),
            "memory": 1024 * usage.ru_maxrss - before,
            "cpu_s": usage.ru_utime + usage.ru_stime,
        }
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    serve()
