"""What a node says of its stages and inputs, and what the graph's status makes of it."""

from panoptic_ros.graph.arrivals import SECOND, ArrivalCounters
from panoptic_ros.graph.counters import StageStatistics
from panoptic_ros.graph.health import Activity, GraphHealth, NodeHealth
from panoptic_ros.stage import Notice


def node(live=True):
    statistics = {"sync": StageStatistics(), "voting": StageStatistics()}
    health = NodeHealth("fusion", statistics, live)
    inputs = [
        ArrivalCounters("detections", name, f"/{name}/detections", True, 0) for name in ("left", "right")
    ]
    for arrivals in inputs:
        health.add(arrivals, "sync")
    return health, statistics, inputs


def by_name(health, now_ns):
    return {status.name: status for status in health.statuses(now_ns)}


def test_a_silent_camera_is_waited_for_by_name_and_the_warning_clears():
    health, _, (left, right) = node()
    for k in range(60):
        left.came(k * SECOND // 30)
        right.came(k * SECOND // 60)
    found = by_name(health, 2 * SECOND + SECOND // 2)
    assert found["sync"].values["waiting_for"] == "right detections"
    assert found["sync"].values["state"] == "waiting" and "right detections" in found["sync"].trouble
    assert found["fusion: right detections"].trouble and not found["fusion: left detections"].trouble
    assert not found["voting"].trouble
    for arrivals in (left, right):
        arrivals.came(3 * SECOND)
    assert not any(status.trouble for status in health.statuses(3 * SECOND + 1))


def test_in_replay_nobody_is_silent():
    health, _, _ = node(live=False)
    assert not any(status.trouble for status in health.statuses(100 * SECOND))


def test_drops_and_notices_warn_for_ten_seconds_with_what_was_new():
    health, statistics, _ = node(live=False)
    sync = statistics["sync"]
    sync.dropped["lost"] = 3
    assert by_name(health, SECOND)["sync"].trouble == "dropped recently: 3 lost"
    sync.dropped["lost"] += 2
    sync.take(Notice("sync.late_frame", "warning", "frame 7 of camera left was dropped", {}))
    trouble = by_name(health, 5 * SECOND)["sync"].trouble
    assert trouble == "dropped recently: 5 lost; frame 7 of camera left was dropped"
    assert not by_name(health, 16 * SECOND)["sync"].trouble
    sync.take(Notice("kinematics.late", "warning", "some were left out", {"left_out": 4}))
    sync.take(Notice("kinematics.late", "warning", "some were left out", {"left_out": 1}))
    assert by_name(health, 17 * SECOND)["sync"].values["dropped.late"] == "5"
    assert not by_name(health, 28 * SECOND)["sync"].trouble
    sync.dropped["lost"] += 1
    found = by_name(health, 29 * SECOND)["sync"]
    assert found.trouble == "dropped recently: 1 lost" and found.values["dropped.lost"] == "6"


def test_a_stage_that_stalls_warns_and_one_that_compiles_says_so():
    health, _, _ = node(live=False)
    health.doing = Activity("voting", SECOND)
    assert not by_name(health, 3 * SECOND // 2)["voting"].trouble
    assert by_name(health, 4 * SECOND)["voting"].trouble == "stalled: 3.0 s in one step"
    health.doing = Activity("voting", SECOND, "voting.kernels.votes")
    found = by_name(health, 4 * SECOND)["voting"]
    assert found.values["state"] == "compiling" and found.values["compiling"] == "voting.kernels.votes"
    health.doing = Activity()
    assert by_name(health, 5 * SECOND)["voting"].values["state"] == "running"


def test_a_node_without_rig_says_what_it_waits_for():
    health, _, _ = node()
    health.awaited = ["rig"]
    found = by_name(health, SECOND)["voting"]
    assert found.values["state"] == "starting" and found.trouble == "waits for rig"


def test_another_rig_that_is_not_worked_with_warns_as_long_as_it_is_there():
    health, _, _ = node()
    health.unfit = ["another /rig has other cameras"]
    assert "another /rig has other cameras" in by_name(health, 60 * SECOND)["voting"].trouble
    health.unfit = []
    assert "rig" not in by_name(health, 60 * SECOND)["voting"].trouble


def test_the_graph_names_a_node_that_is_not_heard_until_it_is_again():
    graph = GraphHealth()

    def hear(node, now_ns, trouble=""):
        graph.heard(node, {"node": node, "finished": "false"}, trouble, now_ns)

    for second in range(4):
        hear("fusion", second * SECOND)
    hear("detection_0", 3 * SECOND, "waits for left image")
    (status,) = graph.statuses(4 * SECOND)
    assert status.trouble == "detection_0: waits for left image"
    for second in (4, 5, 6):
        hear("detection_0", second * SECOND)
    (status,) = graph.statuses(6 * SECOND)
    assert status.trouble == "no message from node fusion for 3.0 s"
    assert status.values == {"nodes": "2", "silent": "fusion", "warnings": "1"}
    hear("fusion", 6 * SECOND)
    assert not graph.statuses(7 * SECOND)[0].trouble
