"""The bench of the live graph: nothing is lost with little to do, and every number is there."""

import json

import pytest

from panoptic_ros.cli.main import main
from panoptic_ros.graph.nodes import FUSION
from panoptic_ros.study.live.graph import Graph
from panoptic_ros.study.names import parsed

FEW = ["study", "graph", "--people", "2", "--views", "3", "--rate", "10", "--seconds", "3"]


@pytest.mark.ros
def test_few_people_are_fed_and_none_is_lost(capsys):
    pytest.importorskip("rclpy")
    assert main([*FEW, "--hosts", "one", "--kill", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    [row] = result["rows"]
    assert 25 <= row["sent"] == row["received"] and row["lost"] == 0
    assert all(row[column.key] is not None for column in Graph.columns)
    assert set(row["steps_ms"]) == {"sync", *FUSION, "health"}
    [restart] = row["restarts"]  # people are followed on by the process that comes after
    assert restart["process"] == "fusion" and restart["silence_s"] > 0.0
    assert restart["people"] == 2 and restart["kept"] >= 1  # slow machines need seconds, in which they walk
    text = "\n".join(parsed("graph", []).lines(result))
    assert "fusion killed: skeletons after" in text and "of 2 identities kept" in text
    assert "2 people, 3 views at 10 Hz" in text and all(column.title in text for column in Graph.columns)


@pytest.mark.parametrize(
    "more, said",
    [
        (["--seconds", "0"], "'0' is not a number from 1 to 3600"),
        (["--rate", "1000"], "'1000' is not a number from 1 to 240"),
        (["--views", "1"], "1 views"),
        (["--scenario", "nowhere"], "nowhere"),
        (["--bag", "there", "--people", "3"], "leave them out"),
    ],
)
def test_numbers_that_make_no_sense_are_told(more, said, capsys):
    pytest.importorskip("rclpy")
    assert main([*FEW, *more] if "--bag" not in more else ["study", "graph", *more]) == 2
    assert said in capsys.readouterr().err
