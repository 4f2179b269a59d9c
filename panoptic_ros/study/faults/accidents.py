"""Staged accidents of live takes: closed terminals, full disks, killed processes.

Each accident happens at a random moment to a separate `panoptic run --topics` or `panoptic record`, which
records the messages of stand-in drivers. Afterwards this module repairs the take if it was not closed, reads
it, and compares its newest timestamp with the time of the accident.
"""

from __future__ import annotations

import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.domain import Camera, Rig
from panoptic_ros.errors import PanopticError, UsageError
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.io.bags import BagReader
from panoptic_ros.io.files import write_json
from panoptic_ros.io.frame_stream import CutFileWarning
from panoptic_ros.io.interruption import SIGNALS
from panoptic_ros.io.plain_formats import read_skeletons
from panoptic_ros.io.rigs import write_rig
from panoptic_ros.io.takes import unclosed_take
from panoptic_ros.running.takes import save_take
from panoptic_ros.stage import Progress, untold

SECOND = 1_000_000_000
TOPIC = "/drivers/{}/image_raw"  # image topic of a stand-in driver; {} = camera name
FOREIGN = ("detections", "skeletons", "diagnostics")  # kinds of foreign messages that the drivers can send
RATE_HZ = 8.0  # image rate of each stand-in camera; one core runs two networks at this rate
STARTED_S = 60.0  # timeout for the first message of a take
ENDED_S = 40.0  # timeout for a process to exit after a request
LATENCY_S = 0.7  # from image timestamp to its detections in the launcher, on a busy machine
LOST_S = 1.0  # limit of the time that an accident may lose, latency excluded
# bytes by which the bag may still grow; one or two seconds of data
A_LITTLE = {"run": 20_000, "record": 1_000_000}
GRAPH = ("/cam0/detections", "/cam1/detections")
IMAGES = tuple(TOPIC.format(name) for name in ("cam0", "cam1"))


@dataclass
class AccidentOutcome:
    """Outcome of an accident.

    Args:
        lost_s: time (s) from the newest saved timestamp to the accident; None where nothing could be lost.
        code: exit code of the process.
        said: last line that the process printed.
        fault: reason why the accident is treated as failed; "" = passed.
    """

    name: str
    lost_s: float | None = None
    code: int | None = None
    said: str = ""
    fault: str = ""


@dataclass
class AccidentEnvironment:
    """Environment of the accidents: stand-in drivers, a rig, and a folder for takes.

    Args:
        drivers: process of the drivers.
        rng: random generator of the moments.
    """

    folder: Path
    rig: Path
    topics: Path
    drivers: subprocess.Popen[bytes]
    rng: random.Random
    environment: Mapping[str, str] = field(default_factory=dict)

    def command(self, verb: str, out: Path, *more: str) -> list[str]:
        """Return the command line of a take."""
        program = [sys.executable, "-m", "panoptic_ros.cli.main"]
        if verb == "record":
            what = ["--keep-free", "0.001", "--topic", "/drivers/*"]
        else:
            what = ["--topics", str(self.topics), "--rig", str(self.rig)]
        return [*program, verb, *what, "--out", str(out), *more]

    def send(self, what: str) -> None:
        """Make the drivers send a foreign message."""
        assert self.drivers.stdin is not None
        self.drivers.stdin.write(f"{what}\n".encode())
        self.drivers.stdin.flush()


class Take:
    """A take that a separate process records.

    Args:
        verb: run or record.
        how: further arguments of `subprocess.Popen`.
    """

    def __init__(self, stage: AccidentEnvironment, verb: str, out: Path, *more: str, **how: Any):
        self.out, self.verb = out, verb
        self.log = stage.folder / f"{out.name}.log"
        if "stdout" not in how:
            how |= {"stdout": self.log.open("wb"), "stderr": subprocess.STDOUT}
        variables = {**os.environ, **stage.environment, **how.pop("variables", {})}

        self.process = subprocess.Popen(
            stage.command(verb, out, *more),
            stdin=subprocess.DEVNULL,
            env=variables,
            start_new_session=True,
            preexec_fn=_heed_signals,
            **how,
        )

    @property
    def bag(self) -> Path:
        """Return the path of the bag."""
        return self.out / "bag" if self.verb == "run" else self.out

    def wait(self, seconds: float) -> None:
        """Wait for the first recorded data, then for this many seconds.

        Raises:
            TimeoutError: if nothing is recorded within `STARTED_S`, or the process ends.
        """
        file, end = self.bag / f"{self.bag.name}.mcap", time.monotonic() + STARTED_S
        while not (file.is_file() and file.stat().st_size > 2000):
            if time.monotonic() > end or self.process.poll() is not None:
                raise TimeoutError(f"nothing was recorded: {self.said()}")
            time.sleep(0.02)
        time.sleep(seconds)

    def said(self) -> str:
        """Return the last line that the process printed."""
        lines = self.log.read_text(errors="replace").strip().splitlines() if self.log.is_file() else []
        return lines[-1] if lines else ""

    def end(self, number: int | None = None) -> int | None:
        """Send a signal, if one is given, and return the exit code.

        After `ENDED_S` it kills the process with SIGABRT, so that the log has a trace, and returns None.
        """
        if number is not None:
            self.process.send_signal(number)
        with suppress(subprocess.TimeoutExpired):
            return self.process.wait(ENDED_S)
        self.process.send_signal(signal.SIGABRT)
        self.process.wait()
        return None


def _heed_signals() -> None:
    """Restore the default signal handlers, because background jobs of a shell ignore requests to end."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_DFL)


def newest_saved(take: Take, folder: Path) -> int:
    """Return the newest readable timestamp (ns) of a take; repair the take first if it was not closed.

    Raises:
        PanopticError: if nothing can be read.
    """
    place = take.out
    if unclosed_take(place) is not None:
        place = folder / f"{take.out.name}-repaired"
        save_take(take.out, place)
    bag = place / "bag" if (place / "bag").is_dir() else place
    topics = GRAPH if take.verb == "run" else IMAGES
    with BagReader(bag) as reader:
        stamps = [message.header.stamp for _, _, message in reader.messages(*topics)]
        sets = [stamp for _, stamp, _, _ in reader.raw("/skeletons")]
    newest = max((stamp.sec * SECOND + stamp.nanosec for stamp in stamps), default=0)
    if take.verb == "run" and sets:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", CutFileWarning)
            frames = read_skeletons(place / "skeletons.json.gz").frames
        in_file = max((frame.stamp_ns for frame in frames), default=0)
        newest -= max(0, max(sets) - in_file)  # bag and skeleton file are synced together
    return newest


Codes = tuple[int | None, ...]


def _judged(
    stage: AccidentEnvironment, take: Take, outcome: AccidentOutcome, when_ns: int, codes: Codes
) -> AccidentOutcome:
    """Fill in the outcome: compare the saved data with the accident time, and check the exit code."""
    outcome.said = take.said()
    try:
        outcome.lost_s = (when_ns - newest_saved(take, stage.folder)) / SECOND
    except PanopticError as error:
        outcome.fault = str(error)
        return outcome
    if outcome.lost_s > LOST_S + LATENCY_S:
        outcome.fault = f"{outcome.lost_s:.1f} s were lost"
    elif outcome.code not in codes:
        outcome.fault = f"exit code {outcome.code}"
    elif take.log.is_file() and "Traceback" in take.log.read_text(errors="replace"):
        outcome.fault = "a traceback was printed"
    return outcome


def _asked_to_end(
    stage: AccidentEnvironment, take: Take, outcome: AccidentOutcome, number: int = signal.SIGINT
) -> AccidentOutcome:
    """End a take by a signal; it must close with exit code 0."""
    when = time.time_ns()
    outcome.code = take.end(number)
    return _judged(stage, take, outcome, when, (0,))


Accident = Callable[[AccidentEnvironment, AccidentOutcome, str, Path], AccidentOutcome]


def _moment(stage: AccidentEnvironment) -> float:
    return stage.rng.uniform(1.5, 5.0)


def _signalled(*numbers: int, codes: Codes = (0,), apart_s: float = 0.0) -> Accident:
    def happen(stage: AccidentEnvironment, outcome: AccidentOutcome, verb: str, out: Path) -> AccidentOutcome:
        take = Take(stage, verb, out)
        take.wait(_moment(stage))
        when = time.time_ns()
        for number in numbers[:-1]:
            take.process.send_signal(number)
            time.sleep(apart_s)
        outcome.code = take.end(numbers[-1])
        return _judged(stage, take, outcome, when, codes)

    return happen


def _terminal_closed(
    stage: AccidentEnvironment, outcome: AccidentOutcome, verb: str, out: Path
) -> AccidentOutcome:
    """Close the terminal; the take must continue until SIGTERM."""
    master, slave = os.openpty()
    take = Take(stage, verb, out, stdout=slave, stderr=slave)
    os.close(slave)
    take.wait(1.0)
    os.close(master)
    time.sleep(_moment(stage))
    return _asked_to_end(stage, take, outcome, signal.SIGTERM)


def _reader_ended(
    stage: AccidentEnvironment, outcome: AccidentOutcome, verb: str, out: Path
) -> AccidentOutcome:
    """Close the reading end of `... 2>&1 | tee log`, then send Ctrl-C."""
    reader, writer = os.pipe()
    take = Take(stage, verb, out, stdout=writer, stderr=writer)
    os.close(writer)
    take.wait(_moment(stage))
    os.close(reader)
    return _asked_to_end(stage, take, outcome)


def _foreign(what: str) -> Accident:
    def happen(stage: AccidentEnvironment, outcome: AccidentOutcome, verb: str, out: Path) -> AccidentOutcome:
        take = Take(stage, verb, out)
        take.wait(1.0)
        for _ in range(5):
            stage.send(what)
            time.sleep(0.3)
        stage.send("none")
        time.sleep(_moment(stage))
        outcome = _asked_to_end(stage, take, outcome)
        if not outcome.fault and "was dropped" not in take.log.read_text(errors="replace"):
            outcome.fault = "no foreign message was dropped and named"
        return outcome

    return happen


def _file_full(stage: AccidentEnvironment, outcome: AccidentOutcome, verb: str, out: Path) -> AccidentOutcome:
    """Limit the file size of the process, which acts like a full disk."""
    take = Take(stage, verb, out)
    take.wait(_moment(stage))
    file = take.bag / f"{take.bag.name}.mcap"
    size = file.stat().st_size + A_LITTLE[verb]
    resource.prlimit(take.process.pid, resource.RLIMIT_FSIZE, (size, size))
    outcome.code = take.end()
    return _judged(stage, take, outcome, file.stat().st_mtime_ns, (2,))


def _mounted(size: str | None, ends: bool) -> Accident:
    """Return an accident that puts the take on a separate disk.

    Args:
        size: disk size in the format of `mount`; None = 64 MB.
        ends: fill up the disk during the take.
    """

    def happen(stage: AccidentEnvironment, outcome: AccidentOutcome, verb: str, out: Path) -> AccidentOutcome:
        place = out.with_name(f"{out.name}-disk")
        place.mkdir()
        words = ["mount", "-t", "tmpfs", "-o", f"size={size or '64m'}", "none", str(place)]
        if shutil.which("mount") is None or subprocess.run(words, capture_output=True).returncode:
            outcome.said = "not tried: a disk can be mounted by root only"
            return outcome
        try:
            take = Take(stage, verb, place if verb == "run" else place / "take")
            take.wait(_moment(stage))
            when = time.time_ns()
            if ends:
                with open(place / "filler", "wb", buffering=0) as file, suppress(OSError):
                    while True:
                        file.write(bytes(1 << 16))
                outcome.code = take.end()
            else:
                outcome.code = take.end(signal.SIGINT)
            return _judged(stage, take, outcome, when, (2,) if ends else (0,))
        finally:
            subprocess.run(["umount", "-l", str(place)], capture_output=True)

    return happen


def _told_before(prepare: Callable[[Path], None], kept: Callable[[Path], bool]) -> Accident:
    """Return an accident with an unusable output path.

    The process must print one line and exit with code 2. Everything at the path must stay.
    """

    def happen(stage: AccidentEnvironment, outcome: AccidentOutcome, verb: str, out: Path) -> AccidentOutcome:
        prepare(out)
        take = Take(stage, verb, out)
        outcome.code = take.end()
        lines = take.log.read_text(errors="replace").strip().splitlines()
        outcome.said = lines[-1] if lines else ""
        if outcome.code != 2 or not kept(out) or any("Traceback" in line for line in lines):
            outcome.fault = f"exit code {outcome.code}, kept: {kept(out)}"
        return outcome

    return happen


def _twice(stage: AccidentEnvironment, outcome: AccidentOutcome, verb: str, out: Path) -> AccidentOutcome:
    """Run the same command twice; the second must be refused and the first take must stay."""
    take = Take(stage, verb, out)
    take.wait(_moment(stage))
    when = time.time_ns()
    first = take.end(signal.SIGINT)
    again = Take(stage, verb, out)
    outcome.code = again.end()
    outcome = _judged(stage, take, outcome, when, (2,))
    outcome.fault = outcome.fault or ("" if first == 0 else f"the first take ended with exit code {first}")
    return outcome


def _with_variables(**variables: str) -> Accident:
    def happen(stage: AccidentEnvironment, outcome: AccidentOutcome, verb: str, out: Path) -> AccidentOutcome:
        take = Take(stage, verb, out, variables=variables)
        take.wait(_moment(stage))
        return _asked_to_end(stage, take, outcome)

    return happen


def _node_killed(
    stage: AccidentEnvironment, outcome: AccidentOutcome, verb: str, out: Path
) -> AccidentOutcome:
    """Kill a node of the graph; the take must continue."""
    take = Take(stage, verb, out)
    take.wait(2.0)
    killed = 0
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):
            log = os.readlink(path.with_name("fd") / "1")
            if log == str(out.resolve() / "logs" / "fusion.log"):
                os.kill(int(path.parent.name), signal.SIGKILL)
                killed += 1
    time.sleep(8.0 + _moment(stage))
    outcome = _asked_to_end(stage, take, outcome)
    outcome.fault = outcome.fault or ("" if killed else "no node was found to kill")
    return outcome


def _says_when(stage: AccidentEnvironment, outcome: AccidentOutcome, verb: str, out: Path) -> AccidentOutcome:
    """Compare the time of the output line "recording PATH" with the timestamp of the first message."""
    reader, writer = os.pipe()
    take = Take(stage, verb, out, stdout=writer, stderr=writer)
    os.close(writer)
    with os.fdopen(reader, "rb") as lines:
        for line in lines:
            if line.startswith(b"recording "):
                break
        said = time.time_ns()
        time.sleep(2.0)
        take.process.send_signal(signal.SIGINT)
        lines.read()
    outcome.code = take.end()
    with BagReader(out) as bag:
        first = min(stamp for _, stamp, _, _ in bag.raw(*IMAGES))
    outcome.lost_s = (first - said) / SECOND
    outcome.said = f"first message {outcome.lost_s:+.2f} s after the line"
    if outcome.code != 0 or not -0.5 < outcome.lost_s < 0.7:
        outcome.fault = f"exit code {outcome.code}"
    return outcome


def _make_file(out: Path) -> None:
    out.write_text("mine")


def _make_notes(out: Path) -> None:
    out.mkdir()
    (out / "notes.txt").write_text("mine")


def _make_dangling(out: Path) -> None:
    out.symlink_to(out.with_name("nothing"))


ACCIDENTS: dict[str, tuple[str, Accident]] = {
    f"{verb}: {name}": (verb, accident)
    for verb, accidents in {
        "run": {
            "killed": _signalled(signal.SIGKILL, codes=(-9,)),
            "killed while it ends": _signalled(signal.SIGINT, signal.SIGKILL, codes=(-9, 0), apart_s=0.3),
            "SIGTERM": _signalled(signal.SIGTERM),
            "SIGHUP": _signalled(signal.SIGHUP),
            "Ctrl-C": _signalled(signal.SIGINT),
            "Ctrl-C thrice at once": _signalled(*3 * [signal.SIGINT], apart_s=0.2),
            "Ctrl-C again after 5.2 s": _signalled(*2 * [signal.SIGINT], apart_s=5.2),
            "terminal closed": _terminal_closed,
            "tee ended": _reader_ended,
            **{f"foreign {what}": _foreign(what) for what in FOREIGN},
            "file too large": _file_full,
            "on a mount point": _mounted(None, ends=False),
            "disk filled up": _mounted("24m", ends=True),
            "MPLBACKEND": _with_variables(MPLBACKEND="no_such_backend"),
            "node killed": _node_killed,
            "the same command twice": _twice,
            "--out a file": _told_before(_make_file, lambda out: out.read_text() == "mine"),
            "--out with a user's file": _told_before(_make_notes, lambda out: (out / "notes.txt").is_file()),
            "--out a dangling link": _told_before(_make_dangling, Path.is_symlink),
        },
        "record": {
            "killed": _signalled(signal.SIGKILL, codes=(-9,)),
            "SIGTERM": _signalled(signal.SIGTERM),
            "SIGHUP": _signalled(signal.SIGHUP),
            "Ctrl-C": _signalled(signal.SIGINT),
            "terminal closed": _terminal_closed,
            "tee ended": _reader_ended,
            "file too large": _file_full,
            "disk filled up": _mounted("24m", ends=True),
            "the same command twice": _twice,
            "--out with a user's file": _told_before(_make_notes, lambda out: (out / "notes.txt").is_file()),
            "--out a dangling link": _told_before(_make_dangling, Path.is_symlink),
            "says when it records": _says_when,
        },
    }.items()
    for name, accident in accidents.items()
}


def stage_accidents(seed: int, wanted: str = "", progress: Progress = untold) -> list[AccidentOutcome]:
    """Run every accident once, at random moments from this seed.

    Args:
        wanted: substring of the names of the accidents to stage; "" = all.

    Returns:
        outcomes in the order of the table `ACCIDENTS`.

    Raises:
        UsageError: if no name contains the substring.
    """
    names = [name for name in ACCIDENTS if wanted in name]
    if not names:
        raise UsageError(f"no accident has {wanted!r} in its name; there are {', '.join(ACCIDENTS)}")
    outcomes = []
    with (
        tempfile.TemporaryDirectory(prefix="panoptic-accidents-") as folder,
        _staged(Path(folder), seed) as stage,
    ):
        for number, name in enumerate(names):
            progress(number / len(names), name)
            verb, accident = ACCIDENTS[name]
            outcome = AccidentOutcome(name)
            try:
                outcomes.append(accident(stage, outcome, verb, stage.folder / f"take{number}"))
            except (OSError, PanopticError) as error:
                outcome.fault = str(error)
                outcomes.append(outcome)
    return outcomes


@contextmanager
def _staged(folder: Path, seed: int) -> Iterator[AccidentEnvironment]:
    rig, topics, state = folder / "rig.json", folder / "drivers.yaml", folder / "state"
    write_rig(rig, _rig())
    write_json(topics, {name: {"image": TOPIC.format(name)} for name in ("cam0", "cam1")})
    environment = {
        "XDG_STATE_HOME": str(state),
        "ROS_DOMAIN_ID": str(random.Random(os.getpid()).randrange(40, 100)),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "PYTHONFAULTHANDLER": "1",
    }
    program = [sys.executable, "-m", "panoptic_ros.nodes.sources.stand_in_drivers"]
    drivers = subprocess.Popen(
        [*program, str(rig), TOPIC, str(RATE_HZ)],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, **environment},
    )
    try:
        yield AccidentEnvironment(folder, rig, topics, drivers, random.Random(seed), environment)
    finally:
        assert drivers.stdin is not None
        drivers.stdin.close()
        with suppress(subprocess.TimeoutExpired):
            drivers.wait(5.0)
        drivers.kill()


def _rig() -> Rig:
    """Return two small cameras with crossing fields of view."""
    matrix = np.array([[180.0, 0, 80], [0, 180.0, 60], [0, 0, 1]])
    turned = [np.array([[0.0, side, 0], [0, 0, -1], [-side, 0, 0]]) for side in (1.0, -1.0)]
    return Rig(
        tuple(
            Camera(
                f"cam{k}", (160, 120), Intrinsics(matrix, np.zeros(5)), Rigid(r, np.array([0.0, 1.2, 3.0]))
            )
            for k, r in enumerate(turned)
        )
    )
