"""The bench of bodies: every mix is solved, and the table has its figures."""

from panoptic_ros.cli.main import main
from panoptic_ros.running.benches import kinematics as kinematics_bench


def test_costs_are_told_for_every_mix(monkeypatch, capsys):
    monkeypatch.setattr(kinematics_bench, "KINDS", ((2, 6), (0, 13)))
    assert main(["bench", "kinematics", "--seconds", "2"]) == 0
    rows = capsys.readouterr().out.splitlines()
    assert [row.split()[:2] for row in rows[2:4]] == [["2", "6"], ["0", "13"]]
    assert rows[4].endswith("% of a core")


def test_a_capture_that_there_is_not_is_told(capsys):
    assert main(["bench", "kinematics", "--seconds", "90"]) == 2
    assert "--seconds 90" in capsys.readouterr().err
