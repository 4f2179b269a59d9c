"""What is said while nothing comes."""

from panoptic_ros.running.runs.finish import why_waiting


def test_the_first_stage_that_waits_is_named():
    counted = {
        "sync": {"state": "waiting", "waiting_for": "left detections"},
        "detection_0": {"state": "waiting", "waiting_for": "left image"},
        "detection_0: left image": {"topic": "/left/image_raw"},
    }
    assert "detection_0 waits for left image" in why_waiting(counted)
    assert "detections" not in why_waiting(counted)


def test_compilation_is_named_where_a_node_says_so_or_nobody_says_anything():
    compiling = {"fusion": {"compiling": "voting.seeds", "waiting_for": "left detections"}}
    assert "compiled" in why_waiting(compiling) and "compiled" in why_waiting({})
