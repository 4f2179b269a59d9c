"""The entry point: exit codes, one line per mistake, and interruptions whatever they come out as."""

import errno
import os
import time

import pytest

from panoptic_ros.cli import config
from panoptic_ros.cli import main as entry
from panoptic_ros.errors import ContractError, DataError
from panoptic_ros.io import interruption


@pytest.fixture
def raising(monkeypatch):
    def let(error):
        def run(args):
            raise error

        monkeypatch.setattr(config, "run", run)

    return let


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (DataError("x is bad"), 2, "panoptic config: x is bad"),
        (ContractError("a bug"), 1, "panoptic config: a bug"),
        (
            OSError(errno.ENOSPC, "Disk full"),
            2,
            "panoptic config: Disk full: make room, also for compiled "
            "kernels (50 MB in the user's cache, or in NUMBA_CACHE_DIR)",
        ),
        (KeyboardInterrupt(), 2, "panoptic config: interrupted"),
    ],
)
def test_errors_become_one_line_and_a_code(raising, capsys, error, code, line):
    raising(error)
    assert entry.main(["config", "show"]) == code
    assert capsys.readouterr().err == line + "\n"


def test_bugs_show_where_they_are(raising):
    raising(ZeroDivisionError())
    with pytest.raises(ZeroDivisionError):
        entry.main(["config", "show"])


@pytest.mark.parametrize("error", [ImportError("no _devicearray"), DataError("half a file")])
def test_what_a_library_makes_of_an_interruption(raising, capsys, monkeypatch, error):
    monkeypatch.setattr(interruption, "_interruptions", [time.monotonic()])
    raising(error)
    assert entry.main(["config", "show"]) == 2
    assert capsys.readouterr().err == "panoptic config: interrupted\n"


@pytest.mark.parametrize("words", [[], ["walk"], ["config"], ["config", "show", "--loud"]])
def test_wrong_arguments_are_one_line(capsys, words):
    assert entry.main(words) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1 and "--help" in lines[0]


@pytest.mark.parametrize("verb", entry.VERBS)
def test_help_of_every_verb(capsys, verb):
    with pytest.raises(SystemExit) as end:
        entry.main([verb, "--help"])
    assert end.value.code == 0 and f"panoptic {verb}" in capsys.readouterr().out


def test_libraries_are_told_to_use_one_thread_unless_somebody_said_otherwise(monkeypatch):
    told = {"OPENBLAS_NUM_THREADS": "3"}
    monkeypatch.setattr(os, "environ", told)
    monkeypatch.setattr(os, "_exit", lambda code: None)
    monkeypatch.setattr(entry, "listen_to_signals", lambda: None)
    monkeypatch.setattr(entry, "main", lambda: 0)
    entry.program()
    assert told == {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "3", "MKL_NUM_THREADS": "1"}
