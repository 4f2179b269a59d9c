"""Starts, supervises and ends the child processes of a launcher.

A process that dies is replaced. If a fork server with all modules loaded is ready, it forks the successor.
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

PROFILE = "FASTRTPS_DEFAULT_PROFILES_FILE"  # environment variable with the path of the Fast DDS profile
SENDER, LOCAL, LISTENER = "fastdds.xml", "fastdds_local.xml", "fastdds_listener.xml"
RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
MOST_REVIVALS = 5  # restarts of one process per minute


HOST = (sys.executable, "-m", "panoptic_ros.nodes.main", "host")
MODULE = "panoptic_ros.running.processes.fork_server"
PATIENCE_S = 1.0  # s, timeout of a fork; after this time the successor is started without the fork server
ASK_S = 0.01


class ChildProcess(Protocol):
    """Common interface of `subprocess.Popen` and `ForkedProcess`."""

    pid: int

    def poll(self) -> int | None:
        """Return the exit code; None while the process runs."""

    def wait(self, timeout: float | None = None) -> int:
        """Wait for the end of the process and return its exit code."""

    def kill(self) -> None:
        """Kill the process."""

    def send_signal(self, sig: int) -> None:
        """Send a signal."""


class ForkedProcess:
    """Process that the fork server has forked."""

    def __init__(self, server: ForkServer, pid: int):
        self._server, self.pid = server, pid

    def poll(self) -> int | None:
        """Return the exit code, see `ChildProcess`."""
        return self._server.code_of(self.pid)

    def wait(self, timeout: float | None = None) -> int:
        """Wait for the exit code, see `ChildProcess`.

        Raises:
            subprocess.TimeoutExpired: if the process still runs after the timeout.
        """
        deadline = None if timeout is None else time.monotonic() + timeout
        while (code := self.poll()) is None:
            if deadline is not None and time.monotonic() > deadline:
                raise subprocess.TimeoutExpired(str(self.pid), timeout or 0.0)
            time.sleep(ASK_S)
        return code

    def kill(self) -> None:
        """Kill the process, see `ChildProcess`."""
        self.send_signal(signal.SIGKILL)

    def send_signal(self, sig: int) -> None:
        """Send a signal, see `ChildProcess`."""
        if self.poll() is None:
            try:
                os.kill(self.pid, sig)
            except ProcessLookupError:  # the process has just ended
                pass


class ForkServer:
    """Client of the fork server process. The server starts at once and is ready some seconds later.

    Args:
        log: file for the standard error of the server.
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

    def fork(self, name: str, log: Path) -> ForkedProcess | None:
        """Start a process of the launch file; return None if the server cannot fork now."""
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
                self.close()  # a late fork would start the process twice
                return None
            time.sleep(ASK_S)
            self._read()
        return ForkedProcess(self, self._forked.pop(name))

    def code_of(self, pid: int) -> int | None:
        """Return the exit code of a forked process; None while it runs."""
        self._read()
        if pid not in self._codes and self._process.poll() is not None:
            return -signal.SIGKILL  # a dead server reports no exit codes; its children end with it
        return self._codes.get(pid)

    def close(self) -> None:
        """End the server. The processes that it forked end, too."""
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


class DomainListener(Protocol):
    """Listener for other graphs in the ROS domain."""

    def require_no_other_graph(self) -> None:
        """Check for other graphs, see `nodes.domain_claim.require_no_other_graph`."""

    def close(self) -> None:
        """Stop listening."""


class LaunchPreparation:
    """Work that runs while the launcher still plans.

    A process loads the nodes, and a listener looks for other graphs. The object is a context manager that
    ends both.

    Attributes:
        listener: None while nothing listens.
    """

    def __init__(self, wanted: bool = True):
        self._process: subprocess.Popen[bytes] | None = None
        self.listener: DomainListener | None = None
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

    def become(self, launch_file: Path, name: str, log: Path) -> ChildProcess | None:
        """Let the preloaded process run a process of the launch file; return None if it is in use or dead."""
        process, self._process = self._process, None
        if process is None or process.stdin is None:
            return None
        words = [str(launch_file), name, str(os.getpid()), str(log)]
        try:
            process.stdin.write(json.dumps(words).encode() + b"\n")
            process.stdin.close()
        except BrokenPipeError:  # it crashed; the caller starts it again, and its log will show the error
            process.wait()
            return None
        return process

    def __enter__(self) -> LaunchPreparation:
        return self

    def __exit__(self, *exception: object) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
        if self.listener is not None:
            self.listener.close()


NOBODY_AHEAD = LaunchPreparation(wanted=False)


class Processes:
    """Processes of one launch file. A context manager that leaves no process running.

    Each child leads its own session, so that Ctrl-C reaches only the launcher. The launcher then ends the
    children in order. The output of each child goes to its own log file.

    Args:
        revived: whether `revive` will be called. If so, a fork server with all modules loaded is kept ready.
        ahead: preloaded process that becomes the first child.
    """

    def __init__(
        self,
        launch_file: Path,
        names: Iterable[str],
        logs: Path,
        revived: bool = False,
        ahead: LaunchPreparation = NOBODY_AHEAD,
    ):
        self._logs = logs
        self._launch_file = launch_file
        self._children: dict[str, ChildProcess] = {}
        self._server: ForkServer | None = None
        self._asked = False  # whether the children were asked to end
        self._revived: dict[str, list[float]] = {}  # times of the restarts by process name, s
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
        except BaseException:  # no other code could end the children that run already
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
        """Return the process ids of the children."""
        return tuple(child.pid for child in self._children.values())

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the processes."""
        return tuple(self._children)

    def kill(self, name: str) -> None:
        """Kill a process by SIGKILL, as the system does."""
        self._children[name].kill()
        self._children[name].wait()

    def check(self) -> None:
        """Check that all children run.

        Raises:
            UserError: with the line that a child printed, if it ended for a reason that the user can fix.
            EnvironmentProblem: if a child was killed.
            ContractError: if a child crashed.
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
                    f"process {name} was killed by the system or by a user; systems do so when memory runs "
                    "out: free some, or use fewer cameras or smaller images"
                )
            tail = " | ".join(lines[-3:])
            raise ContractError(f"process {name} ended with exit code {code}: {tail or 'no output'}")

    def revive(self) -> list[str]:
        """Restart the children that were killed or crashed; return a line about each.

        Raises:
            PanopticError: as `check`, if a child ended for a reason that the user can fix, or ended too
                often.
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
            told.append(f"process {name} {how} and is restarted")
        self.check()
        return told

    def ask_to_end(self) -> None:
        """Ask all children to end, once. `stop` waits for their end."""
        if not self._asked:
            self._asked = True
            for child in self._children.values():
                if child.poll() is None:
                    child.send_signal(signal.SIGINT)

    def stop(self, patience_s: float = 8.0) -> None:
        """End all children: by SIGINT first, by SIGKILL after the timeout.

        Args:
            patience_s: timeout, s.
        """
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
    """Set the environment of this process for its part in the graph. Variables that the user has set stay.

    Discovery stays on this machine by default, so that a replay does not reach other hosts.

    Args:
        profile: Fast DDS profile. Use `LISTENER` for a process that sends nothing large. "" selects `LOCAL`
            if all nodes are on this machine, else `SENDER`.
    """
    reach = os.environ.setdefault(RANGE, "LOCALHOST")
    profile = profile or (SENDER if reach.upper() in ("SUBNET", "SYSTEM_DEFAULT") else LOCAL)
    if profile_path(profile).is_file():
        os.environ.setdefault(PROFILE, str(profile_path(profile)))


def profile_path(profile: str = SENDER) -> Path:
    """Return the path of a Fast DDS profile.

    Args:
        profile: `SENDER`, `LOCAL` or `LISTENER`.
    """
    return share_folder() / "config" / profile


def child_environment() -> dict[str, str]:
    """Return the environment of the children. BLAS gets one thread per child, as there are many processes."""
    threads = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")}
    return {**threads, **os.environ, "PYTHONUNBUFFERED": "1"}
