"""Child processes of a launcher: started, watched, and ended in any case.

Successors of processes that died: forked by a process that has everything loaded, where that is ready.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Protocol

from panoptic_ros.errors import ContractError, EnvironmentProblem, UserError
from panoptic_ros.io.files import file_errors
from panoptic_ros.io.resources import share_folder
from panoptic_ros.running.processes.shared_memory import full

PROFILE = "FASTRTPS_DEFAULT_PROFILES_FILE"  # the variable that names it
SENDER, LOCAL, LISTENER = "fastdds.xml", "fastdds_local.xml", "fastdds_listener.xml"
RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
MOST_REVIVALS = 5  # of one process in a minute


HOST = (sys.executable, "-m", "panoptic_ros.nodes.main", "host")
MODULE = "panoptic_ros.running.processes.fork_server"
PATIENCE_S = 1.0  # for a fork; then the successor is started in the slow way
ASK_S = 0.01


class Child(Protocol):
    """What `subprocess.Popen` and `Forked` have in common."""

    pid: int

    def poll(self) -> int | None:
        """The exit code, None while it runs."""

    def wait(self, timeout: float | None = None) -> int:
        """Wait for the exit code."""

    def kill(self) -> None:
        """Kill it."""

    def send_signal(self, sig: int) -> None:
        """Send a signal."""


class Forked:
    """A process that is a child of the fork server."""

    def __init__(self, server: ForkServer, pid: int):
        self._server, self.pid = server, pid

    def poll(self) -> int | None:
        """See `Child`."""
        return self._server.code_of(self.pid)

    def wait(self, timeout: float | None = None) -> int:
        """See `Child`.

        Raises:
            subprocess.TimeoutExpired: if it still runs.
        """
        deadline = None if timeout is None else time.monotonic() + timeout
        while (code := self.poll()) is None:
            if deadline is not None and time.monotonic() > deadline:
                raise subprocess.TimeoutExpired(str(self.pid), timeout or 0.0)
            time.sleep(ASK_S)
        return code

    def kill(self) -> None:
        """See `Child`."""
        self.send_signal(signal.SIGKILL)

    def send_signal(self, sig: int) -> None:
        """See `Child`."""
        if self.poll() is None:
            try:
                os.kill(self.pid, sig)
            except ProcessLookupError:  # it has just ended
                pass


class ForkServer:
    """The process that forks; started at once, ready some seconds later.

    Args:
        log: what it prints on stderr goes there.
    """

    def __init__(self, launch_file: Path, log: Path, environment: Mapping[str, str]):
        with log.open("wb") as output:
            self._process = subprocess.Popen(
                [sys.executable, "-m", MODULE, str(launch_file)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=output,
                env=dict(environment),
                start_new_session=True,
            )
        assert self._process.stdout is not None
        os.set_blocking(self._process.stdout.fileno(), False)
        self._rest = b""
        self._codes: dict[int, int] = {}
        self._forked: dict[str, int] = {}
        self.ready = False

    def fork(self, name: str, log: Path) -> Forked | None:
        """Start a process of the launch file; None if that cannot be done now."""
        self._read()
        if not self.ready or self._process.poll() is not None:
            return None
        assert self._process.stdin is not None
        self._forked.pop(name, None)
        try:
            self._process.stdin.write(f"{name}\t{log}\n".encode())
            self._process.stdin.flush()
        except BrokenPipeError:
            return None
        deadline = time.monotonic() + PATIENCE_S
        while name not in self._forked:
            if time.monotonic() > deadline or self._process.poll() is not None:
                self.close()  # it must not fork later
                return None
            time.sleep(ASK_S)
            self._read()
        return Forked(self, self._forked.pop(name))

    def code_of(self, pid: int) -> int | None:
        """The exit code of a forked process; None while it runs."""
        self._read()
        if pid not in self._codes and self._process.poll() is not None:
            return -signal.SIGKILL  # nobody is left to tell; it ends with the server
        return self._codes.get(pid)

    def close(self) -> None:
        """End the server; what it forked ends, too."""
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait()
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                try:
                    stream.close()
                except BrokenPipeError:
                    pass
        self.ready = False

    def _read(self) -> None:
        assert self._process.stdout is not None
        if self._process.stdout.closed:
            return
        data = self._process.stdout.read()
        *lines, self._rest = (self._rest + (data or b"")).split(b"\n")
        for line in lines:
            self._take(line.decode().split(" "))

    def _take(self, words: list[str]) -> None:
        if words[0] == "ready":
            self.ready = True
        elif words[0] == "forked":
            self._forked[words[1]] = int(words[2])
        elif words[0] == "ended":
            self._codes[int(words[1])] = int(words[2])


class Listener(Protocol):
    """Hears of other graphs."""

    def require_no_other_graph(self) -> None:
        """See `nodes.domain_claim.require_no_other_graph`."""

    def close(self) -> None:
        """Listen no more."""


class Ahead:
    """What goes on while the launcher still plans: a process loads nodes, and somebody listens for other
    graphs. A context manager that ends both.

    Attributes:
        listener: None while nobody listens.
    """

    def __init__(self, wanted: bool = True):
        self._process: subprocess.Popen[bytes] | None = None
        self.listener: Listener | None = None
        if wanted:
            prepare_environment()
            self._process = subprocess.Popen(
                HOST,
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env=child_environment(),
                start_new_session=True,
            )

    def become(self, launch_file: Path, name: str, log: Path) -> Child | None:
        """Let it run a process of a launch file; None if there is none any more."""
        process, self._process = self._process, None
        if process is None or process.stdin is None:
            return None
        words = [str(launch_file), name, str(os.getpid()), str(log)]
        try:
            process.stdin.write(json.dumps(words).encode() + b"\n")
            process.stdin.close()
        except BrokenPipeError:  # it broke down; started anew it will tell why
            process.wait()
            return None
        return process

    def __enter__(self) -> Ahead:
        return self

    def __exit__(self, *exception: object) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
        if self.listener is not None:
            self.listener.close()


NOBODY_AHEAD = Ahead(wanted=False)


class Processes:
    """The processes of one launch file; a context manager that leaves none behind.

    Each child leads a session of its own, so that Ctrl-C reaches the launcher alone, which then ends
    them in order. What they print goes to one log file each.

    Args:
        revived: whether `revive` will be called: a process stands by then that has everything loaded.
        ahead: becomes the first of them.
    """

    def __init__(
        self,
        launch_file: Path,
        names: Iterable[str],
        logs: Path,
        revived: bool = False,
        ahead: Ahead = NOBODY_AHEAD,
    ):
        self._logs = logs
        self._launch_file = launch_file
        self._children: dict[str, Child] = {}
        self._server: ForkServer | None = None
        self._asked = False  # to end
        self._revived: dict[str, list[float]] = {}  # when, by process
        with file_errors(logs, "write"):
            logs.mkdir(parents=True, exist_ok=True)
        try:
            for name in names:
                loaded = ahead.become(launch_file, name, logs / f"{name}.log")
                if loaded is None:
                    self._start(name)
                else:
                    self._children[name] = loaded
            if revived:
                self._server = ForkServer(launch_file, logs / "successors.log", child_environment())
        except BaseException:  # nobody else knows of those that run already
            self.stop(3.0)
            raise

    def _start(self, name: str) -> None:
        mode = "ab" if name in self._children else "wb"
        with file_errors(self._logs, "write"), (self._logs / f"{name}.log").open(mode) as log:
            self._children[name] = subprocess.Popen(
                [*HOST, str(self._launch_file), name, str(os.getpid())],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=child_environment(),
                start_new_session=True,
            )

    @property
    def ids(self) -> tuple[int, ...]:
        """The process ids of the children."""
        return tuple(child.pid for child in self._children.values())

    @property
    def names(self) -> tuple[str, ...]:
        """Of the processes."""
        return tuple(self._children)

    def kill(self, name: str) -> None:
        """Kill a process as the system does, without a warning."""
        self._children[name].kill()
        self._children[name].wait()

    def check(self) -> None:
        """Look whether all children run.

        Raises:
            UserError: with the line that a child printed, if it ended for what the user can mend.
            EnvironmentProblem: if it was killed.
            ContractError: if it broke down.
        """
        for name, child in self._children.items():
            code = child.poll()
            if code is None:
                continue
            lines = (self._logs / f"{name}.log").read_text(errors="replace").strip().splitlines()
            said = [line.removeprefix("panoptic: ") for line in lines if line.startswith("panoptic: ")]
            if code == 2 and said:
                raise UserError(said[-1])
            if code == -signal.SIGBUS:
                raise EnvironmentProblem(f"process {name} ended by a bus error: {full()}")
            if code == -signal.SIGKILL:
                raise EnvironmentProblem(
                    f"process {name} was killed by the system or by somebody; systems do so when memory runs "
                    "out: free some, or use fewer cameras or smaller images"
                )
            tail = " | ".join(lines[-3:])
            raise ContractError(f"process {name} ended with exit code {code}: {tail or 'it said nothing'}")

    def revive(self) -> list[str]:
        """Start anew what was killed or broke down; a line for each.

        Raises:
            PanopticError: as `check`, if a process ended for what the user can mend, or time and again.
        """
        now, told = time.monotonic(), []
        for name, child in self._children.items():
            code = child.poll()
            if code in (None, 0, 2):
                continue
            recent = [when for when in self._revived.get(name, []) if now - when < 60.0]
            if len(recent) >= MOST_REVIVALS:
                break
            self._revived[name] = [*recent, now]
            successor = self._server.fork(name, self._logs / f"{name}.log") if self._server else None
            if successor is None:
                self._start(name)
            else:
                self._children[name] = successor
            how = f"was killed (signal {-code})" if code < 0 else f"broke down (exit code {code})"
            told.append(f"process {name} {how} and is started anew")
        self.check()
        return told

    def ask_to_end(self) -> None:
        """Ask all children to end, once; `stop` waits until they have."""
        if not self._asked:
            self._asked = True
            for child in self._children.values():
                if child.poll() is None:
                    child.send_signal(signal.SIGINT)

    def stop(self, patience_s: float = 8.0) -> None:
        """End all children: SIGINT first, SIGKILL for those who do not listen."""
        self.ask_to_end()
        deadline = time.monotonic() + patience_s
        for child in self._children.values():
            try:
                child.wait(max(0.0, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                child.kill()
                child.wait()
        if self._server is not None:
            self._server.close()

    def __enter__(self) -> Processes:
        return self

    def __exit__(self, *exception: object) -> None:
        self.stop(8.0 if exception[0] is None else 3.0)


def prepare_environment(profile: str = "") -> None:
    """Settings for this process's own part in the graph; what the user has set stays.

    A replay is nobody else's business: discovery stays on this machine.

    Args:
        profile: of the middleware, `LISTENER` where nothing large is sent; "" = `LOCAL` where all nodes are
            on this machine, else `SENDER`.
    """
    reach = os.environ.setdefault(RANGE, "LOCALHOST")
    profile = profile or (SENDER if reach.upper() in ("SUBNET", "SYSTEM_DEFAULT") else LOCAL)
    if profile_path(profile).is_file():
        os.environ.setdefault(PROFILE, str(profile_path(profile)))


def profile_path(profile: str = SENDER) -> Path:
    """The Fast DDS profile of every process of the graph, or of those that only listen."""
    return share_folder() / "config" / profile


def child_environment() -> dict[str, str]:
    """The environment of the children: one thread each for BLAS, as there are many processes."""
    threads = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")}
    return {**threads, **os.environ, "PYTHONUNBUFFERED": "1"}
