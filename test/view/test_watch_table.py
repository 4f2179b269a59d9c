"""The lines of `panoptic watch`."""

from panoptic_ros.graph.health import ReceivedStatus
from panoptic_ros.view.watch_table import watch_lines

STAGE = {
    "node": "fusion",
    "state": "running",
    "rate_hz": "29.98",
    "age_s": "0.03",
    "step_p50_ms": "0.091",
    "step_p99_ms": "nan",
    "latency_p50_ms": "4.10",
    "latency_p99_ms": "9.02",
    "dropped.lost": "3",
}
INPUT = {
    "node": "fusion",
    "stage": "sync",
    "topic": "/left/detections",
    "rate_hz": "30.00",
    "age_s": "0.01",
    "latency_p50_ms": "2.00",
    "latency_p99_ms": "5.00",
    "lost": "3",
    "left_out": "0",
    "bad": "1",
}


def told(name, values, trouble="", namespace="", heard_s=10.0):
    return ReceivedStatus(namespace, name, trouble, values, heard_s)


def test_stages_and_inputs_have_a_row_each():
    lines = watch_lines([told("sync", STAGE), told("fusion: left detections", INPUT)], 10.2)
    assert lines[0] == "graph /: 1 node, all is well"
    assert next(line for line in lines if line.startswith("sync")).split() == [
        "sync",
        "fusion",
        "running",
        "30.0",
        "0.0",
        "0.1",
        "-",
        "4.1",
        "9.0",
        "lost",
        "3",
    ]
    assert next(line for line in lines if line.startswith("left detections")).split() == [
        "left",
        "detections",
        "fusion",
        "30.0",
        "0.0",
        "2.0",
        "5.0",
        "3",
        "0",
        "1",
    ]


def test_warnings_and_silent_nodes_come_first_and_graphs_stay_apart():
    lines = watch_lines(
        [
            told("sync", STAGE, "waits for left detections"),
            told("sync", STAGE | {"node": "sync"}, namespace="lab", heard_s=6.0),
        ],
        10.2,
    )
    assert lines[:2] == ["graph /: 1 node, 1 warning", "  WARN  sync: waits for left detections"]
    other = lines.index("graph /lab: 1 node, 1 warning")
    assert lines[other + 1] == "  WARN  no message from node sync for 2.5 s or more"
    assert any("4.2" not in line and "3.2" in line for line in lines[other:])  # the age goes on


def test_a_graph_whose_nodes_are_not_there_yet_is_not_well():
    (line,) = watch_lines([ReceivedStatus("lab", "graph", "", {"nodes": "0"}, 10.0)], 10.2)
    assert line == "graph /lab: no stage has reported yet, or its run is over"
