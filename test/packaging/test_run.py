"""The script `run`, with a stand-in for Python that notes what it is asked to do."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest

import panoptic_ros

ROOT = Path(panoptic_ros.__file__).resolve().parent.parent
TOOLS = (
    "bash",
    "cat",
    "dirname",
    "env",
    "find",
    "flock",
    "getconf",
    "grep",
    "head",
    "mkdir",
    "mktemp",
    "readlink",
    "rm",
    "sed",
    "sha256sum",
    "sleep",
    "sort",
    "tail",
    "touch",
    "uname",
    "xargs",
)

PYTHON = """#!/usr/bin/env bash
# Stands for the system's Python and for the one in .venv/; the latter notes each call of pip.
here=$(dirname "$0")
case "$*" in
  -V) echo "Python ${FAKE_VERSION:-3.11.2}" ;;
  *sys.exit*version_info*) [[ ${FAKE_VERSION:-3.11.2} == 3.1[0-3].* ]] ;;
  *print*version_info*) echo 3.11 ;;
  *ensurepip*) [[ ! -e $here/no-ensurepip ]] ;;
  *get_path*) dirname "$(command -v python3)" ;;
  *get_config_var*) echo "${FAKE_COMPILER:-bash} -pthread" ;;
  "-m venv "*)
    mkdir -p "$3/bin"
    echo "VIRTUAL_ENV='$3'" >"$3/bin/activate"
    cat "$0" >"$3/bin/python"
    printf '#!/usr/bin/env bash\\necho "panoptic $*"; [[ $1 != run ]] || exit 7\\n' >"$3/bin/panoptic"
    chmod +x "$3/bin/python" "$3/bin/panoptic" ;;
  "-m pip "*)
    echo "$* [PYTHONPATH=${PYTHONPATH-unset} GUARD=${_ROS_WHEELS_BOOTSTRAP_COMPLETE-unset}]" >>"$CALLS"
    sleep "${FAKE_SECONDS:-0}"
    [[ ! ${FAKE_FAULT:-} || "$*" != *"$FAKE_FAULT"* ]] || { echo "ERROR: it went wrong"; exit 1; }
    if [[ $3 == wheel ]]; then mkdir -p "$here/../wheels"; touch "$here/../wheels/messages.whl"; fi ;;
  "-m pytest"*) echo "$*"; exit 5 ;;
  *"import "*panoptic_msgs*) [[ ! ${FAKE_FAULT:-} ]] ;;
esac
"""


class Machine:
    """A checkout and the few programs that a machine has."""

    def __init__(self, folder: Path):
        self.checkout = folder / "the checkout"
        self.programs = folder / "bin"
        self.calls = folder / "calls"
        self.venv = self.checkout / ".venv"
        self.programs.mkdir(parents=True)
        for tool in TOOLS:
            (self.programs / tool).symlink_to(str(shutil.which(tool)))
        for tool in ("python3", "chmod", "npm"):
            self._program(tool, PYTHON if tool == "python3" else f'#!/bin/sh\nexec /bin/{tool} "$@"\n')
        (self.programs / "Python.h").touch()
        (self.checkout / "panoptic_ros").mkdir(parents=True)
        (self.checkout / "msg_defs" / "msg").mkdir(parents=True)
        for name in ("run", "setup.cfg", "setup.py", "panoptic_ros/__init__.py"):
            shutil.copy2(ROOT / name, self.checkout / name)
        (self.checkout / "msg_defs" / "msg" / "Some.msg").write_text("uint8 one\n")

    def _program(self, name: str, text: str) -> None:
        (self.programs / name).write_text(text)
        (self.programs / name).chmod(0o755)

    def start(self, *arguments: str, **variables: str) -> subprocess.Popen[str]:
        environment = {"PATH": str(self.programs), "HOME": str(self.checkout), "CALLS": str(self.calls)}
        return subprocess.Popen(
            [str(self.checkout / "run"), *arguments],
            cwd=self.checkout.parent,
            env={**environment, **variables},
            start_new_session=True,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def run(self, *arguments: str, **variables: str) -> tuple[int, str, list[str]]:
        """Exit code, standard output, lines of standard error."""
        process = self.start(*arguments, **variables)
        output, errors = process.communicate(timeout=30)
        return process.returncode, output, errors.splitlines()

    def pip_calls(self) -> list[str]:
        """What pip was asked since the last look."""
        lines = self.calls.read_text().splitlines() if self.calls.exists() else []
        self.calls.write_text("")
        return lines


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    return Machine(tmp_path)


def test_scripts_are_valid_and_executable() -> None:
    for script in (ROOT / "run", ROOT / ".ci" / "run"):
        assert os.access(script, os.X_OK)
        assert subprocess.run(["bash", "-n", str(script)], check=False).returncode == 0


def test_help_names_every_command(machine: Machine) -> None:
    for arguments in ((), ("help",), ("--help",)):
        code, output, errors = machine.run(*arguments)
        assert code == 0 and not errors
        assert all(f"\n  {command} " in output for command in ("setup", "demo", "test", "help"))


@pytest.mark.parametrize("arguments", [("install",), ("setup", "--fast")])
def test_wrong_use_is_told_in_one_line(machine: Machine, arguments: tuple[str, ...]) -> None:
    code, output, errors = machine.run(*arguments)
    assert (code, output, len(errors)) == (2, "", 1)
    assert arguments[-1] in errors[0]


def test_setup_installs_once(machine: Machine) -> None:
    code, _, errors = machine.run("setup")
    assert code == 0, errors
    calls = machine.pip_calls()
    assert [call.split()[2] for call in calls] == ["install", "install", "wheel", "install"]
    assert str(machine.checkout) + "[test]" in calls[1]
    assert not (machine.venv / "unfinished").exists()
    assert machine.run("setup") == (0, "", ["run: panoptic warm-up"])  # asked each time
    assert machine.pip_calls() == []


def test_only_what_changed_is_installed_again(machine: Machine) -> None:
    machine.run("setup")
    machine.pip_calls()
    (machine.checkout / "msg_defs" / "msg" / "Other.msg").write_text("uint8 two\n")
    assert machine.run("setup")[0] == 0
    assert [call.split()[2] for call in machine.pip_calls()] == ["wheel", "install"]
    with (machine.checkout / "setup.cfg").open("a") as file:
        file.write("# another requirement\n")
    assert machine.run("setup")[0] == 0
    assert [call.split()[2] for call in machine.pip_calls()] == ["install", "install"]


def test_another_python_installs_all_again(machine: Machine) -> None:
    machine.run("setup")
    machine.pip_calls()
    assert machine.run("setup", FAKE_VERSION="3.12.1")[0] == 0
    assert len(machine.pip_calls()) == 4


def test_a_checkout_that_was_moved_is_set_up_anew(machine: Machine) -> None:
    machine.run("setup")
    machine.pip_calls()
    moved = machine.checkout.with_name("elsewhere")
    machine.checkout.rename(moved)
    machine.checkout, machine.venv = moved, moved / ".venv"
    code, _, errors = machine.run("setup")
    assert code == 0 and "making it anew" in errors[0]
    assert len(machine.pip_calls()) == 4


def test_a_failed_download_is_told_and_tried_again(machine: Machine) -> None:
    code, _, errors = machine.run("setup", FAKE_FAULT="--editable")
    assert code == 2
    assert "ERROR: it went wrong" in errors[-2]
    assert str(machine.venv / "setup.log") in errors[-1]
    code, _, errors = machine.run("setup")
    assert code == 0 and "did not finish" in errors[0]


def test_what_an_interruption_left_is_not_trusted(machine: Machine) -> None:
    process = machine.start("setup", FAKE_SECONDS="3")
    deadline = time.monotonic() + 10
    while not (machine.calls.exists() and machine.calls.read_text()) and time.monotonic() < deadline:
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=20)
    assert process.returncode == 130
    assert errors.splitlines()[-1] == "run: interrupted"
    assert (machine.venv / "unfinished").exists()
    code, _, lines = machine.run("setup")
    assert code == 0 and "did not finish" in lines[0]


def test_two_at_once_install_once(machine: Machine) -> None:
    processes = [machine.start("setup", FAKE_SECONDS="0.1") for _ in range(2)]
    told = [process.communicate(timeout=30)[1] for process in processes]
    assert [process.returncode for process in processes] == [0, 0]
    assert len(machine.pip_calls()) == 4
    assert any("waiting for another" in text for text in told)


def test_missing_system_packages_are_named_in_one_line(machine: Machine) -> None:
    (machine.programs / "no-ensurepip").touch()
    (machine.programs / "Python.h").unlink()
    code, output, errors = machine.run("setup", FAKE_COMPILER="no-such-compiler")  # apt-get is not there
    assert (code, output, len(errors)) == (2, "", 1)
    assert errors[0].endswith("sudo apt-get install python3.11-venv libpython3.11-dev g++")
    assert not machine.venv.exists()


@pytest.mark.parametrize("version", ["3.9.2", "3.14.0", "none"])
def test_an_unsuitable_python_is_told_in_one_line(machine: Machine, version: str) -> None:
    if version == "none":
        (machine.programs / "python3").unlink()
    code, output, errors = machine.run("setup", FAKE_VERSION=version)
    assert (code, output, len(errors)) == (2, "", 1)
    assert "3.10 to 3.13" in errors[0]


def test_without_npm_one_is_installed(machine: Machine) -> None:
    (machine.programs / "npm").unlink()
    machine.run("setup")
    assert "[test,npm]" in machine.pip_calls()[1]


def test_other_environments_stay_outside(machine: Machine, tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "librcl.so").touch()
    code, _, errors = machine.run(
        "setup",
        PYTHONPATH="/opt/ros/jazzy",
        _ROS_WHEELS_BOOTSTRAP_COMPLETE="1",
        LD_LIBRARY_PATH=f"{tmp_path / 'other'}:/usr/lib",
    )
    assert code == 0, errors
    assert all("PYTHONPATH=unset GUARD=unset" in call for call in machine.pip_calls())


def test_demo_and_test_pass_arguments_and_exit_codes(machine: Machine) -> None:
    code, output, errors = machine.run("demo", "--live-view", "a b")
    out = machine.checkout / "out" / "demo"
    assert code == 7, errors
    assert output.splitlines() == [
        "panoptic models fetch",
        f"panoptic run --demo --out {out} --live-view a b",
    ]
    code, output, _ = machine.run("test", "-k", "some thing")
    assert code == 5
    side_by_side = "--numprocesses auto --maxprocesses 4"
    assert output.splitlines() == ["panoptic models fetch", f"-m pytest {side_by_side} -k some thing"]


def test_a_place_that_cannot_be_written_is_told_in_one_line(machine: Machine) -> None:
    machine.venv.symlink_to(machine.checkout / "nowhere")  # mkdir fails, for root as well
    code, _, errors = machine.run("setup")
    assert (code, len(errors)) == (2, 1) and "permissions" in errors[0]
