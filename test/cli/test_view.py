"""`panoptic view`: wrong use is told in one line; the page is there until Ctrl-C."""

import re
import signal
import subprocess
import sys
import urllib.request

import pytest
from recorded_scene import write_scene

from panoptic_ros.cli.main import main


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ([], "give the results of a run, a bag, a capture folder, or --live"),
        (["x", "--live"], "give the results of a run, a bag, a capture folder, or --live"),
        (["--live", "--skeleton", "panoptic19"], "have no meaning with --live"),
        (["{tmp}/nothing"], "there is no {tmp}/nothing"),
        (["{tmp}/results"], "has a report.json but no bag/"),
        (["{tmp}/bag", "--port", "99999"], "--port"),
    ],
)
def test_wrong_use_is_told_in_one_line(arguments, told, tmp_path, capsys):
    write_scene(tmp_path / "bag", 2)
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / "report.json").write_text("{}")
    assert main(["view", *(word.format(tmp=tmp_path) for word in arguments)]) == 2
    error = capsys.readouterr().err
    assert told.format(tmp=tmp_path) in error and error.count("\n") == 1


def test_a_page_is_there_until_it_is_interrupted(tmp_path):
    write_scene(tmp_path / "bag", 10)
    command = [sys.executable, "-m", "panoptic_ros.cli.main", "view", str(tmp_path / "bag")]
    process = subprocess.Popen([*command, "--port", "0", "--no-browser"], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    (address,) = re.findall(r"http://127\.0\.0\.1:\d+/\?token=\S+", process.stdout.readline())
    assert b"<title>panoptic</title>" in urllib.request.urlopen(address).read()
    process.send_signal(signal.SIGINT)
    assert process.wait(10) == 0
    assert process.stdout.read() == ""
    process.stdout.close()
