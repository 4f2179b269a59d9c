"""Staged accidents: nothing that a live take recorded more than a second before is lost."""

import json
import os
import signal
import subprocess
import sys
import time
import warnings

import captures
import live_take
import pytest
from fork_server import ForkServer
from recordings import write_bag
from repeated_bag import repeat

from panoptic_ros.cli.main import main
from panoptic_ros.io.bags import BagReader
from panoptic_ros.io.frame_stream import CutFileWarning
from panoptic_ros.io.plain_formats import read_skeletons
from panoptic_ros.io.takes import OPEN, unclosed_take
from panoptic_ros.running.takes import save_take

SECOND = 1_000_000_000


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    folder = tmp_path_factory.mktemp("people")
    return repeat(write_bag(folder / "short", captures.views(60)), folder / "bag", 15.0)


@pytest.fixture(scope="module")
def server():
    with ForkServer("live_take") as server:
        yield server


@pytest.fixture
def take(server, bag, tmp_path):
    """Starts a live take that is forked from the server."""
    return lambda *more, **how: Take(bag, tmp_path, *more, server=server, **how)


class Take:
    """A live take in a process that is forked from a server, or in one of its own.

    Args:
        output: a pipe or a terminal, in place of the file that tells what was said.
    """

    def __init__(self, bag, folder, *more, server=None, variables=None, output=None, largest_file=None):
        self.out, self.told = folder / "live", folder / "told"
        self.told.touch()
        self._said = folder / f"said{len(list(folder.iterdir()))}"
        self._said.touch()
        words, variables = [str(bag), str(self.out), *more], {"TOLD": str(self.told), **(variables or {})}
        if server is not None:
            how = {"variables": variables, "largest_file": largest_file}
            self.process = server.start(*words, output=output or self._said, **how)
        else:
            command = [sys.executable, "-W", "ignore", live_take.__file__, *words]
            with self._said.open("w") as said:
                how = {"stdout": said, "stderr": said, "start_new_session": True}
                self.process = subprocess.Popen(command, env={**os.environ, **variables}, **how)

    def taken(self):
        """Stamps of the instants that were taken so far."""
        return [int(line) for line in self.told.read_text().splitlines()]

    def wait(self, count):
        end = time.monotonic() + 60
        while len(self.taken()) < count:
            assert time.monotonic() < end and self.process.poll() is None, self._said.read_text()
            time.sleep(0.01)

    def end(self):
        return self.process.wait(), self._said.read_text()


def stamps_in(out, name="bag"):
    """Stamps of skeletons in the bag and in skeletons.json.gz of results."""
    with BagReader(out / name) as reader:
        in_bag = [stamp for _, stamp, _ in reader.messages("/skeletons")]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CutFileWarning)
        return in_bag, [frame.stamp_ns for frame in read_skeletons(out / "skeletons.json.gz").frames]


def check(found, taken, lost_s):
    for stamps in found:
        assert stamps == taken[: len(stamps)] or stamps[: len(taken)] == taken
        assert not taken or taken[-1] - stamps[-1] <= lost_s * SECOND


def test_a_killed_take_is_named_and_saved_up_to_the_last_second(take, capsys):
    take = take()
    take.wait(75)
    os.killpg(take.process.pid, signal.SIGKILL)
    assert take.end()[0] == -signal.SIGKILL
    taken = take.taken()
    named = unclosed_take(take.out)
    assert named is not None and main(["view", str(take.out), "--no-browser"]) == 2
    assert "was not closed" in capsys.readouterr().err
    assert main(["bag", "repair", str(take.out)]) == 0
    saved = take.out.with_name("live-repaired")
    check(stamps_in(saved), taken, 1.0)
    check([stamps_in(take.out.with_name("live-repaired"))[1]], taken, 1.0)
    assert unclosed_take(take.out) is None and (take.out / "bag").is_dir()
    assert main(["bag", "repair", str(take.out)]) == 2  # there already, and not replaced


def test_a_power_cut_costs_what_came_after_the_last_sync(bag, tmp_path, monkeypatch):
    """Files are cut to their lengths at the last fsync that ended a second before."""
    log = tmp_path / "synced"
    hook = tmp_path / "hook"
    hook.mkdir()
    (hook / "sitecustomize.py").write_text(
        "import os, time\nreal = os.fsync\nlog = os.open(os.environ['SYNCED'], os.O_WRONLY | os.O_CREAT | "
        "os.O_APPEND)\ndef fsync(fd):\n    size = os.fstat(fd).st_size\n    real(fd)\n    os.write(log, "
        "f'{os.readlink(f\"/proc/self/fd/{fd}\")} {size}\\n'.encode())\nos.fsync = fsync\n"
    )
    variables = {"SYNCED": str(log), "PYTHONPATH": f"{hook}:{os.environ.get('PYTHONPATH', '')}"}
    take = Take(bag, tmp_path, variables=variables)
    take.wait(75)
    os.killpg(take.process.pid, signal.SIGKILL)
    take.end()
    lengths = dict(line.rsplit(" ", 1) for line in log.read_text().splitlines())
    files = [path for path in take.out.rglob("*") if path.is_file() and path.suffix in (".mcap", ".gz")]
    assert len(files) == 2
    for path in files:
        os.truncate(path, int(lengths[str(path)]))
    saved = save_take(take.out, tmp_path / "saved")
    assert saved.frames["skeletons.json.gz"] > 40
    check(stamps_in(tmp_path / "saved"), take.taken(), 1.0)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_a_request_to_end_closes_the_take(take, number):
    take = take("--no-pictures")
    take.wait(20)
    take.process.send_signal(number)
    code, said = take.end()
    assert code == 0, said
    check(stamps_in(take.out), take.taken(), 0.0)
    assert "results in" in said and not (take.out / OPEN).exists()


def test_a_second_take_does_not_replace_the_first(take):
    first = take("--no-pictures")
    first.wait(10)
    second = take("--no-pictures")
    code, said = second.end()
    assert code == 2 and "is being recorded now" in said and len(said.strip().splitlines()) == 1
    first.process.send_signal(signal.SIGINT)
    assert first.end()[0] == 0
    code, said = take("--no-pictures").end()
    assert code == 2 and "a live take replaces nothing" in said
    check(stamps_in(first.out), first.taken(), 0.0)


def test_a_terminal_that_is_closed_ends_the_printing(take):
    master, slave = os.openpty()
    take = take(output=os.ttyname(slave))
    os.close(slave)
    take.wait(10)
    os.close(master)
    before = len(take.taken())
    take.wait(before + 30)  # it goes on
    take.process.send_signal(signal.SIGINT)
    assert take.end()[0] == 0
    check(stamps_in(take.out), take.taken(), 0.0)
    assert json.loads((take.out / "report.json").read_text())["frames"]["out"] == len(take.taken())


def test_a_reader_of_the_output_that_ends_first_harms_nothing(take):
    """`panoptic run ... 2>&1 | tee log`, and Ctrl-C, which ends tee at once."""
    tee = subprocess.Popen(["cat"], stdin=subprocess.PIPE, stdout=subprocess.DEVNULL)
    take = take("--no-pictures", output=f"/proc/{os.getpid()}/fd/{tee.stdin.fileno()}")
    tee.stdin.close()
    take.wait(20)
    tee.kill()
    tee.wait()
    take.process.send_signal(signal.SIGINT)
    assert take.end()[0] == 0
    check(stamps_in(take.out), take.taken(), 0.0)


def test_a_full_disk_ends_the_take_in_a_line_and_keeps_what_was_written(take, tmp_path):
    take = take(largest_file=400_000)  # bytes, in place of a small disk
    code, said = take.end()
    assert code == 2 and "File too large" in said and "panoptic bag repair" in said, said
    assert "Traceback" not in said
    saved = save_take(take.out, tmp_path / "saved")
    assert saved.bags["bag"].counts["/skeletons"] > 10
    check(stamps_in(tmp_path / "saved"), take.taken(), 2.0)  # the run ends within a second of the fault


def test_a_wrong_plot_backend_and_a_second_request_do_not_undo_a_take(bag, tmp_path):
    take = Take(bag, tmp_path, variables={"MPLBACKEND": "no_such_backend"})
    take.wait(20)
    take.process.send_signal(signal.SIGINT)
    code, said = take.end()
    assert code == 0 and (take.out / "skeletons.png").is_file(), said
    check(stamps_in(take.out), take.taken(), 0.0)
