"""Progress bar and live table: right numbers, in place in a terminal, plain elsewhere."""
import io
import re

import pytest

from panoptic_ros.view.live_table import LiveTable
from panoptic_ros.view.progress import ProgressBar


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


def test_the_bar_tells_share_rate_and_time_left(clock):
    out = Terminal()
    with ProgressBar(400, "reading", out, clock) as bar:
        for done in range(1, 101):
            clock.now += 0.05
            bar.update(done)
        assert "100/400" in out.screen()[0] and "20.0 frames/s" in out.screen()[0]
        assert "00:15 left" in out.screen()[0] and out.screen()[0].startswith("reading [#######...")
    assert out.getvalue().count("\n") == 1 and len(out.screen()) == 2


def test_the_bar_is_not_drawn_for_each_frame_but_for_the_last(clock):
    out = Terminal()
    bar = ProgressBar(1000, "", out, clock)
    for done in range(1, 1001):
        clock.now += 0.001
        bar.update(done)
    assert 5 <= out.getvalue().count("\r") <= 15
    assert "1000/1000" in out.screen()[0]
    bar.close()
    bar.close()
    bar.update(3)
    assert out.getvalue().count("\n") == 1


def test_the_bar_without_total_and_without_terminal(clock):
    out = Terminal()
    bar = ProgressBar(None, "live", out, clock)
    clock.now += 4000.0
    bar.update(8000)
    assert out.screen()[0] == "live 8000 frames  2.0 frames/s  1:06:40"
    quiet = io.StringIO()
    with ProgressBar(10, "x", quiet, clock) as bar:
        bar.update(10)
    assert quiet.getvalue() == ""


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
