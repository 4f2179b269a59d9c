"""Where walls are known, true joints have more votes and nobody is missed."""

from types import SimpleNamespace

import pytest

from panoptic_ros.bench import visibility
from panoptic_ros.errors import UsageError


def options(**more):
    return SimpleNamespace(**{"frames": 2, "seed": 3, "bag": None, "truth": None, **more})


def test_known_walls_raise_votes_and_lose_nobody():
    result = visibility.measure(options())
    unknown, known = result["rows"]
    assert known["vote"] > 2.0 * unknown["vote"]
    assert known["person_recall"] == 1.0 >= unknown["person_recall"]
    assert known["node_ghosts"] <= unknown["node_ghosts"]
    text = "\n".join(visibility.lines(result))
    assert "rooms-4p31v, seed 3: 2 instants of 31 views" in text and "vote of true joints" in text


def test_a_bag_needs_its_truth():
    with pytest.raises(UsageError, match="--truth together"):
        visibility.measure(options(bag="bag"))
