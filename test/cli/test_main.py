"""The command line's one place for errors."""
import pytest

from panoptic_ros.cli import config as verb
from panoptic_ros.cli.main import main


def interrupted_kernel(args):
    try:
        raise KeyboardInterrupt
    except KeyboardInterrupt as error:
        raise SystemError("a kernel returned a result with an exception set") from error


def test_interruption_of_a_kernel_is_an_interruption(monkeypatch, capsys):
    monkeypatch.setattr(verb, "run", interrupted_kernel)
    assert main(["config", "show"]) == 2
    assert capsys.readouterr().err == "panoptic config: interrupted\n"


def test_other_system_errors_keep_their_traceback(monkeypatch):
    def broken(args):
        raise SystemError("broken")

    monkeypatch.setattr(verb, "run", broken)
    with pytest.raises(SystemError, match="broken"):
        main(["config", "show"])


def test_unknown_verb_is_one_line(capsys):
    assert main(["dance"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
