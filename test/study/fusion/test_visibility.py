"""Where walls are known, true joints have more votes and nobody is missed."""

import pytest

from panoptic_ros.errors import UsageError
from panoptic_ros.study.names import parsed
from panoptic_ros.study.study import run_study


def test_known_walls_raise_votes_and_lose_nobody():
    study = parsed("visibility", ["--frames", "2", "--seeds", "3"])
    result = run_study(study)
    unknown, known = result["rows"]
    assert known["vote"] > 2.0 * unknown["vote"]
    assert known["person_recall"] == 1.0 >= unknown["person_recall"]
    assert known["node_ghosts"] <= unknown["node_ghosts"]
    text = "\n".join(study.lines(result))
    assert "rooms-4p31v, seed 3: 2 instants of 31 views" in text and "vote of true joints" in text


def test_a_bag_needs_its_truth():
    with pytest.raises(UsageError, match="--truth together"):
        run_study(parsed("visibility", ["--bag", "bag"]))
