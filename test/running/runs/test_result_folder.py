"""Only files that a run made are replaced; links, mount points and files of the user stay."""

import json
import os

import pytest

from panoptic_ros.errors import DataError, UserError
from panoptic_ros.io.takes import OPEN, OpenTake
from panoptic_ros.running.runs.result_folder import files_below, open_live_folder, result_folder


@pytest.fixture(autouse=True)
def state(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


def leave(out, files):
    """Run once: write these files, then the report that lists them."""
    with result_folder(out) as folder:
        for name, text in files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text)
        names = sorted([*files_below(folder), "report.json"])
        (folder / "report.json").write_text(json.dumps({"files": names}))


def content(out):
    return {name: (out / name).read_text() for name in files_below(out) if name != "report.json"}


def test_results_replace_those_of_the_last_run_and_nothing_else(tmp_path):
    out = tmp_path / "out"
    leave(out, {"a.txt": "1", "bag/x": "1", "bag/y": "1", "logs/z": "1"})
    (out / "notes.txt").write_text("mine")
    (out / "bag" / "notes.txt").write_text("mine")
    leave(out, {"a.txt": "2", "bag/x": "2"})
    mine = {"notes.txt": "mine", "bag/notes.txt": "mine"}
    assert content(out) == {"a.txt": "2", "bag/x": "2", **mine}
    assert not (out / "logs").exists()


def test_an_error_leaves_the_last_results_or_no_folder(tmp_path):
    out = tmp_path / "out"
    with pytest.raises(KeyError), result_folder(out) as folder:
        (folder / "a.txt").write_text("1")
        raise KeyError
    assert not out.exists()
    leave(out, {"a.txt": "1"})
    with pytest.raises(KeyError), result_folder(out) as folder:
        (folder / "a.txt").write_text("2")
        raise KeyError
    assert content(out) == {"a.txt": "1"} and sorted(os.listdir(out)) == ["a.txt", "report.json"]


def test_a_file_of_the_user_in_the_way_is_kept_and_so_are_the_results(tmp_path):
    out = tmp_path / "out"
    leave(out, {"a.txt": "1"})
    (out / "plot.png").write_text("mine")
    (out / "bag").write_text("mine")
    with pytest.raises(DataError, match="results are in .*results-2"):
        leave(out, {"a.txt": "2", "plot.png": "2", "bag/x": "2"})
    assert content(out) == {
        "a.txt": "1",
        "plot.png": "mine",
        "bag": "mine",
        "results-2/a.txt": "2",
        "results-2/plot.png": "2",
        "results-2/bag/x": "2",
        "results-2/report.json": (out / "results-2" / "report.json").read_text(),
    }


def test_a_link_to_a_folder_is_followed_and_one_to_nothing_refused(tmp_path):
    (tmp_path / "there").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "there")
    leave(tmp_path / "link", {"a.txt": "1"})
    assert (tmp_path / "link").is_symlink() and content(tmp_path / "there") == {"a.txt": "1"}
    (tmp_path / "dangling").symlink_to(tmp_path / "nothing")
    for make in (lambda: leave(tmp_path / "dangling", {}), lambda: open_live_folder(tmp_path / "dangling")):
        with pytest.raises(UserError, match="link to .*nothing, which does not exist"):
            make()
    assert (tmp_path / "dangling").is_symlink()


@pytest.mark.parametrize("name", ["file", "other", "a" * 300])
def test_what_cannot_take_results_is_told_in_a_line(tmp_path, name):
    (tmp_path / "file").write_text("mine")
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "notes.txt").write_text("mine")
    for make in (lambda: leave(tmp_path / name, {}), lambda: open_live_folder(tmp_path / name)):
        with pytest.raises(UserError) as error:
            make()
        assert "\n" not in str(error.value) and name[:5] in str(error.value)
    assert sorted(os.listdir(tmp_path)) in (["file", "other"], ["state", "file", "other"])


def test_a_live_take_replaces_nothing(tmp_path):
    out = tmp_path / "out"
    leave(out, {"a.txt": "1"})
    with pytest.raises(UserError, match="holds a.txt and more; a live take replaces nothing"):
        open_live_folder(out)
    (tmp_path / "empty").mkdir()
    folder = open_live_folder(tmp_path / "empty")
    assert (tmp_path / "empty" / OPEN).is_file()
    with pytest.raises(UserError, match="is being recorded now"):
        leave(tmp_path / "empty", {})
    (tmp_path / "empty" / "notes.txt").write_text("mine")
    (tmp_path / "empty" / "bag").mkdir()
    folder.give_up(["bag", "logs"])
    assert content(tmp_path / "empty") == {"notes.txt": "mine"}


def test_an_open_take_is_not_replaced_by_results(tmp_path):
    (tmp_path / "take").mkdir()
    OpenTake(tmp_path / "take").leave()
    with pytest.raises(UserError, match="was not closed.*panoptic bag repair"):
        leave(tmp_path / "take", {"a.txt": "1"})
    assert os.listdir(tmp_path / "take") == [OPEN]


def test_folders_of_killed_runs_are_removed(tmp_path):
    out = tmp_path / "out"
    (out / ".results-99999999.part").mkdir(parents=True)
    leave(out, {"a.txt": "1"})
    assert sorted(os.listdir(out)) == ["a.txt", "report.json"]
