"""Processes that are forked from one that has imported and loaded what all of them need: they cost little.

`python fork_server.py MODULE` calls `MODULE.load()`, then forks a process that calls `MODULE.begin(*words)`
for each request. Requests and answers are JSON, one a line:

    {"words": [...], "output": PATH, "variables": {...}, "largest_file": BYTES or null} -> its pid
    {"ended": pid, "wait": bool} -> its exit code, as `subprocess` has it, or null
"""

import gc
import json
import os
import resource
import signal
import subprocess
import sys
import traceback
from importlib import import_module


class ForkServer:
    """The server as tests see it, to be used in a `with` statement.

    Args:
        module: of test/support, with `load` and `begin`.
    """

    def __init__(self, module):
        command = [sys.executable, "-W", "ignore", __file__, module]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def __enter__(self):
        return self

    def __exit__(self, *about):
        with self._process:
            self._process.stdin.close()

    def answer(self, **request):
        """What the server answers."""
        print(json.dumps(request), file=self._process.stdin, flush=True)
        return json.loads(self._process.stdout.readline())

    def start(self, *words, output, variables=None, largest_file=None):
        """Fork a process whose output goes to a file, a pipe or a terminal."""
        variables = {key: str(value) for key, value in (variables or {}).items()}
        words = [str(word) for word in words]
        pid = self.answer(words=words, output=str(output), variables=variables, largest_file=largest_file)
        return Forked(self, pid)


class Forked:
    """A process that was forked, in the words of `subprocess.Popen`."""

    def __init__(self, server, pid):
        self._server, self.pid, self.returncode = server, pid, None

    def poll(self):
        """The exit code; None while it runs."""
        return self._code(False)

    def wait(self):
        """The exit code, when it has ended."""
        return self._code(True)

    def send_signal(self, number):
        """Send it, unless the process is known to have ended."""
        if self.returncode is None:
            os.kill(self.pid, number)

    def _code(self, wait):
        if self.returncode is None:
            self.returncode = self._server.answer(ended=self.pid, wait=wait)
        return self.returncode


def start(begin, words, output, variables, largest_file):
    """Fork a process in a session of its own; its id."""
    streams = os.open(output, os.O_WRONLY | os.O_NOCTTY)
    entry = os.open(output if os.isatty(streams) else os.devnull, os.O_RDONLY | os.O_NOCTTY)
    pid = os.fork()
    if pid:
        os.close(streams)
        os.close(entry)
        return pid
    try:
        os.setsid()
        for number, given in enumerate((entry, streams, streams)):
            os.dup2(given, number)
        sys.stdin, sys.stdout, sys.stderr = (
            open(number, mode, buffering=1, closefd=False) for number, mode in enumerate("rww")
        )
        if largest_file is not None:
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (largest_file, largest_file))
        os.environ.update(variables)
        begin(*words)
        code = 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:
        traceback.print_exc()
        code = 1
    sys.stdout.flush()
    os._exit(code)


def ended(pid, wait):
    """The exit code of a process; None while it runs."""
    found, status = os.waitpid(pid, 0 if wait else os.WNOHANG)
    return os.waitstatus_to_exitcode(status) if found else None


def serve(module):
    """Answer requests until there are no more."""
    module.load()
    gc.freeze()  # memory that is not touched is not copied
    for line in sys.stdin:
        request = json.loads(line)
        if "ended" in request:
            answer = ended(request["ended"], request["wait"])
        else:
            answer = start(module.begin, **request)
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    serve(import_module(sys.argv[1]))
