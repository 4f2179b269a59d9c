"""A take is marked open from its first second, and named until somebody closes or saves it."""

import os
import signal
import subprocess
import sys

import pytest

from panoptic_ros.io.takes import OPEN, OpenTake, is_recorded_now, mark_saved, unclosed_take, unclosed_takes


@pytest.fixture(autouse=True)
def state(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "live").mkdir()
    return tmp_path / "live"


def test_an_open_take_is_recorded_and_a_closed_one_is_whole(folder):
    take = OpenTake(folder)
    assert is_recorded_now(folder) and unclosed_take(folder) is None and unclosed_takes() == []
    take.close()
    assert not (folder / OPEN).exists() and not is_recorded_now(folder)
    assert unclosed_take(folder) is None and unclosed_takes() == []


def test_a_take_that_is_left_is_named_with_its_remedy_until_it_is_saved(folder):
    OpenTake(folder).leave()
    (named,) = unclosed_takes()
    assert f"panoptic bag repair {folder}" in str(named) and named.began
    mark_saved(folder)
    assert unclosed_takes() == [] and unclosed_take(folder) is None


def test_a_killed_process_leaves_a_take_that_is_named(folder):
    code = "import sys, time; from pathlib import Path; from panoptic_ros.io.takes import OpenTake; "
    code += "t = OpenTake(Path(sys.argv[1])); print('open', flush=True); time.sleep(60)"
    process = subprocess.Popen([sys.executable, "-c", code, str(folder)], stdout=subprocess.PIPE)
    assert process.stdout.readline() == b"open\n" and is_recorded_now(folder)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert [take.path for take in unclosed_takes()] == [folder.resolve()]


def test_takes_that_are_gone_are_forgotten_but_not_those_on_a_disk_that_is_away(folder, tmp_path):
    OpenTake(folder).leave()
    away = tmp_path / "disk"
    folder.parent.joinpath("disk").mkdir()
    (away / "take").mkdir()
    OpenTake(away / "take").leave()
    os.rename(away, tmp_path / "unplugged")
    (folder / OPEN).unlink()
    assert unclosed_takes() == []
    os.rename(tmp_path / "unplugged", away)
    assert [take.path for take in unclosed_takes()] == [away / "take"]


def test_a_damaged_mark_and_a_state_folder_that_cannot_be_written_do_no_harm(folder, monkeypatch, tmp_path):
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "file"))
    OpenTake(folder).leave()
    assert unclosed_takes() == [] and unclosed_take(folder) is not None
    (folder / OPEN).write_bytes(b"\xff\x00[")
    assert "was not closed" in str(unclosed_take(folder))
