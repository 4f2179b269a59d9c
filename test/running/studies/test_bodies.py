"""The study of cameras and IMUs, on one short capture."""
from panoptic_ros.running.studies import bodies as body_study
from panoptic_ros.simulation.bodies.capture import BodyScene


def test_ours_beside_the_papers_by_cameras_and_imus(monkeypatch):
    monkeypatch.setattr(body_study, "body_scene", lambda name: BodyScene(("02_05",), seconds=3.6, cameras=2))
    result = body_study.study_bodies(("body-punch",), 0, (0, 2), (), lambda *_: None)
    kinds = {(row["cameras"], row["imus"], row["method"]) for row in result["rows"]}
    assert len(kinds) == 10  # 0 cameras with 6 and 13 IMUs, 2 cameras with 0, 6, 13; two methods
    assert all(row["coverage"] == 1.0 and row["mm"] > 1.0 for row in result["rows"])
    lines = list(body_study.study_lines(result))
    assert len(lines) == 12 and "no reproduction of Total Capture" in lines[0]
