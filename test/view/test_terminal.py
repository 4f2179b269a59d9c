"""Progress bars and live table: right numbers, in place in a terminal, plain elsewhere."""

import io
import re
import sys
import time
from itertools import pairwise

import pytest

from panoptic_ros.view.live_table import LiveTable
from panoptic_ros.view.progress import PassBar, ProgressBar


class Terminal(io.StringIO):
    """A terminal that also knows what its screen shows."""

    def isatty(self):
        return True

    def screen(self):
        """The lines after all cursor movements that are used here."""
        rows, at, fresh = [""], 0, False
        text = re.sub(r"\x1b\[38;2;[0-9;]+m|\x1b\[0m", "", self.getvalue())
        for token in re.findall(r"\x1b\[\d*[AKJ]|\r|\n|[^\x1b\r\n]+", text):
            if token.endswith("A") and token[0] == "\x1b":
                at -= int(token[2:-1])
                assert at >= 0
            elif token == "\x1b[K" and fresh:
                rows[at] = ""
            elif token == "\n":
                at += 1
                rows.extend([""] * (at + 1 - len(rows)))
            elif token == "\x1b[J":
                del rows[at:]
                rows.append("")
            elif token[0] not in "\r\x1b":
                rows[at] = token
            fresh = token == "\r"
        return rows


@pytest.fixture
def clock():
    class Clock:
        now = 100.0

        def __call__(self):
            return self.now

    return Clock()


@pytest.fixture
def terminal(monkeypatch, clock):
    """Begins a terminal of 100 columns, to which bars write, and whose time is that of the clock."""
    monkeypatch.setattr(time, "monotonic", clock)
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.setenv("TERM", "xterm")

    def begin():  # in the test: pytest has streams of its own for what comes before it
        out = Terminal()
        monkeypatch.setattr(sys, "stderr", out)
        return out

    return begin


def last_line(out):
    """The line that was drawn last, without colours; bars are of lines."""
    text = re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", out.getvalue())
    return text.rstrip("\n").rpartition("\r")[2].rstrip()


def test_the_bar_tells_share_rate_and_time_left(terminal, clock):
    out = terminal()
    with ProgressBar(400, "reading") as bar:
        for done in range(1, 101):
            clock.now += 0.11
            bar.update(done)
        assert last_line(out).startswith("reading ━━━━━━━╺")
        assert "100/400 9.1 frames/s 00:33 left" in last_line(out)
    assert out.getvalue().count("\n") == 1


def test_the_bar_is_not_drawn_for_each_frame_but_for_the_last(terminal, clock):
    out = terminal()
    bar = ProgressBar(1000)
    for done in range(1, 1001):
        clock.now += 0.001
        bar.update(done)
    assert 5 <= out.getvalue().count("\r") <= 15
    assert "1000/1000" in last_line(out)
    bar.close()
    bar.close()
    bar.update(3)
    assert out.getvalue().count("\n") == 1


def test_the_bar_without_total(terminal, clock):
    out = terminal()
    with ProgressBar(None, "live") as bar:
        for done in range(80, 8001, 80):
            clock.now += 40.0
            bar.update(done)
        assert last_line(out) == "live 8000 frames 2.0 frames/s 1:06:40"


def test_a_pass_tells_its_share_the_time_left_and_what_it_does(terminal, clock):
    out = terminal()
    with PassBar("clocks") as bar:
        bar.show(0.0, "solving")
        assert last_line(out) == f"clocks {28 * '━'}   0% --:-- left  solving"
        for k in range(1, 101):
            clock.now += 0.2
            bar.show(k / 400, "solving")
        assert re.search(r"  25% 01:0[01] left  solving$", last_line(out))
        clock.now += 60.0
        bar.show(1.0, "estimating")
        assert last_line(out) == f"clocks {28 * '━'} 100% 00:00 left  estimating"
    assert out.getvalue().count("\n") == 1


def test_a_pass_is_not_drawn_for_each_step(terminal, clock):
    out = terminal()
    with PassBar("x") as bar:
        for k in range(1001):
            clock.now += 0.001
            bar.show(k / 1000, "step")
    assert 5 <= out.getvalue().count("\r") <= 15


def test_nothing_is_drawn_without_a_terminal(monkeypatch):
    quiet = io.StringIO()
    monkeypatch.setattr(sys, "stderr", quiet)
    with ProgressBar(10, "x") as bar, PassBar("y") as silent:
        bar.update(10)
        silent.show(1.0, "step")
    assert quiet.getvalue() == ""


def test_a_long_line_is_cut_to_the_terminal(terminal, monkeypatch):
    out = terminal()
    monkeypatch.setenv("COLUMNS", "60")
    with PassBar("clocks from motion") as bar:
        bar.show(0.5, "something with a very long name")
        assert len(last_line(out)) <= 60 and "\n" not in out.getvalue()


def test_time_left_does_not_jump_where_steps_are_uneven(terminal, clock):
    """Half of the work takes 20 s, the other half 60 s: the time left is that of the mean pace so far."""
    out = terminal()
    with PassBar("x") as bar:
        bar.show(0.0, "")
        shown = []
        for k in range(1, 800):
            clock.now += 0.1
            elapsed = 0.1 * k
            bar.show(elapsed / 40.0 if elapsed <= 20.0 else 0.5 + (elapsed - 20.0) / 120.0, "")
            if k > 50 and k % 20 == 0:
                minutes, seconds = re.search(r"(\d\d):(\d\d) left", last_line(out)).groups()
                shown.append(60 * int(minutes) + int(seconds))
    assert max(abs(b - a) for a, b in pairwise(shown)) <= 3 and shown[-1] <= 4


def test_the_table_shows_cameras_people_and_latency_in_place(skeleton, make_poses, clock):
    out = Terminal()
    table = LiveTable(["cam0", "cam1"], skeleton, out, clock)
    for i in range(60):
        clock.now += 1 / 30
        table.saw_view("cam0", 2)
        if i % 2:
            table.saw_view("cam1", 1)
        table.saw_poses(make_poses([(0.5, -1.25), (1.0, 1.0)], [12, 3], i), latency_ms=40.0 + i % 2)
    table.set_dropped(7)
    table.close()
    screen = out.screen()
    assert screen == [*table.lines(), ""]
    assert re.match(r"cam0 +30\.0 +2$", screen[1]) and re.match(r"cam1 +15\.0 +1$", screen[2])
    assert re.match(r"id 3 +1\.00 +1\.00 +1\.70 +4/4$", screen[5])
    assert re.match(r"id 12 +0\.50 +-1\.25 +1\.70 +4/4$", screen[6])
    assert "skeletons 30.0/s" in screen[8] and "p50 40 ms" in screen[8] and "7 dropped" in screen[8]
    assert out.getvalue().count("camera") <= 10  # redrawn four times a second, not sixty


def test_a_table_that_shrinks_leaves_nothing_behind(skeleton, make_poses, clock):
    out = Terminal()
    table = LiveTable(["cam0"], skeleton, out, clock)
    table.saw_poses(make_poses([(0, 0), (1, 0), (2, 0)], [1, 2, 3], 0))
    clock.now += 1.0
    table.saw_poses(make_poses([], [], 1))
    assert out.screen() == [*table.lines(), ""] and "nobody" in out.screen()


def test_a_table_that_is_higher_than_the_screen_is_cut(skeleton, make_poses, clock, monkeypatch):
    monkeypatch.setenv("LINES", "20")
    monkeypatch.setenv("COLUMNS", "80")
    out = Terminal()
    table = LiveTable([f"cam{i}" for i in range(31)], skeleton, out, clock)
    for i in range(3):
        clock.now += 1.0
        table.saw_poses(make_poses([(0.1 * k, 0) for k in range(4)], [1, 2, 3, 4], i))
    screen = out.screen()
    assert len(screen) == 20 and "... and 22 more" in screen and screen[-2].startswith("skeletons")


def test_a_silent_camera_falls_to_zero(skeleton, clock):
    table = LiveTable(["cam0"], skeleton, Terminal(), clock)
    table.saw_view("cam0", 1)
    clock.now += 10.0
    assert re.match(r"cam0 +0\.0", table.lines()[1])


def test_no_terminal_gets_plain_lines(skeleton, make_poses, clock):
    out = io.StringIO()
    table = LiveTable(["cam0"], skeleton, out, clock)
    for i in range(100):
        clock.now += 0.1
        table.saw_view("cam0", 1)
        table.saw_poses(make_poses([(0, 0)], [5], i))
    table.close()
    lines = out.getvalue().splitlines()
    assert 5 <= len(lines) <= 7 and "\x1b" not in out.getvalue() and "\r" not in out.getvalue()
    assert lines[-1].startswith("cam0 10.") and lines[-1].endswith("people 5")
