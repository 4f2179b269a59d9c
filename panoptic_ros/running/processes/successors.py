"""Successors of processes that died: forked by a process that has everything loaded, where that is ready."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Protocol

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
