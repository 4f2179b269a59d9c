"""The bench of bodies: every mix is solved, and the table has its figures."""

from study_runs import run_named

from panoptic_ros.cli.main import main
from panoptic_ros.study.bodies import times
from panoptic_ros.study.names import parsed


def test_costs_are_told_for_every_mix(monkeypatch):
    monkeypatch.setattr(times, "KINDS", ((2, 6), (0, 13)))
    result = run_named("kinematics-time", "--seconds 2")
    rows = list(parsed("kinematics-time", []).lines(result))
    assert [row.split()[:2] for row in rows[3:5]] == [["2", "6"], ["0", "13"]]
    assert rows[5].endswith("% of a core")


def test_what_was_seen_live_is_told():
    late = {f"latency_p{share}_ms": 130.0 + share for share in (50, 90, 99, 100)}
    seen = {
        "source": "2 bodies with 26 IMUs",
        "views": 8,
        "rate_hz": 30.0,
        "lag_s": 0.1,
        "load": 0.5,
        "instants_hz": 60.0,
        "bodies": 2.0,
        "dropped_hz": {"late": 3.0, "queue_full": 1.5},
        "skeletons_p50_ms": None,
        "cpu_percent": {"kinematics": 42.4},
        **late,
    }
    text = "\n".join(parsed("kinematics-live", []).lines({"rows": [seen]}))
    assert "180.0 (p50), 220.0 (p90), 229.0 (p99), 230.0 (p100); lag and a camera's period are 133" in text
    assert "3.0 instants/s left out as late; 1.5 messages/s dropped (1.5 queue_full)" in text
    assert "60.0 instants/s with 2.00 bodies" in text and "kinematics 42" in text and "ms: - (p50)" in text


def test_a_live_graph_of_nobody_is_told(capsys):
    assert main(["study", "kinematics-live", "--subjects", "90"]) == 2
    assert "'90' is not a whole number from 1 to 8" in capsys.readouterr().err


def test_a_capture_that_there_is_not_is_told(capsys):
    assert main(["study", "kinematics-time", "--seconds", "90"]) == 2
    assert "'90' is not a number from 2 to 20" in capsys.readouterr().err
