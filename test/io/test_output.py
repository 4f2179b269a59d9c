"""A dead terminal, a pipe without a reader and a full disk end the printing, and nothing else."""

import os
import sys

import pytest

from panoptic_ros.io.output import lossy_output


@pytest.mark.parametrize("kind", ["pipe", "terminal", "full", "closed"])
def test_what_cannot_be_written_is_lost(monkeypatch, kind):
    if kind == "pipe":
        reader, writer = os.pipe()
        os.close(reader)
    elif kind == "terminal":
        master, writer = os.openpty()
        os.close(master)
    else:
        writer = os.open("/dev/full", os.O_WRONLY)
    stream = os.fdopen(writer, "w", buffering=1)
    if kind == "closed":
        stream.close()
    monkeypatch.setattr(sys, "stdout", stream)
    with lossy_output():
        print("lost")
        print("lost", end="", flush=True)
        assert sys.stdout is not stream
    assert sys.stdout is stream
    if kind != "closed":
        with pytest.raises(OSError):
            stream.write("x\n")
        os.dup2(os.open(os.devnull, os.O_WRONLY), writer)  # so that it can be closed


def test_what_can_be_written_is(capsys):
    with lossy_output():
        print("kept")
        print("kept too", file=sys.stderr)
        assert sys.stdout.isatty() is False
    assert capsys.readouterr() == ("kept\n", "kept too\n")
