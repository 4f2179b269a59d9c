"""A child whom adults hide: takes that are drawn, and the measure of its loss."""

from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.errors import UsageError
from panoptic_ros.simulation import SKELETON, Absence
from panoptic_ros.study.names import parsed
from panoptic_ros.study.people.hidden_child import (
    CHILD,
    HARD,
    USUAL,
    ChildInstant,
    child_figures,
    child_take,
    follow_child,
    images_of,
)

HIDDEN = (1.8, 2.6)  # s, within the time in which adults of all takes are down


def unseen(take, begin, end):
    """Return the take whose detector misses the child from `begin` to `end`, s."""
    return replace(take, scene=replace(take.scene, absences=(Absence(CHILD, begin, end),)))


def solved(take):
    return list(follow_child(take, list(take.detection_sets()), SKELETON, {}))


def test_takes_are_drawn_from_the_seed():
    one, again, other = (child_take(seed) for seed in (1, 1, 2))
    assert (one.scene, one.people[CHILD].body) == (again.scene, again.people[CHILD].body)
    assert one.people[CHILD].body != other.people[CHILD].body and one.scene != other.scene
    for kind in (USUAL, HARD):
        for seed in range(6):
            take = child_take(seed, kind)
            assert kind.cameras[0] <= len(take.rig) <= kind.cameras[1]
            assert kind.child[0] <= take.people[CHILD].body.height <= kind.child[1]


def test_images_have_the_stamps_of_their_cameras():
    take = next(take for take in map(child_take, range(20)) if take.scene.timing.phase > 0.0)
    frames = next(images_of(take))
    stamps = take.schedule.stamps[0]
    assert [frame.stamp_ns for frame in frames] == [
        take.stamp_ns(k, stamp) for k, stamp in enumerate(stamps) if np.isfinite(stamp)
    ]


def test_times_lost_are_told_with_who_lost_it():
    numbers = [None, None, 5, 5, None, None, 5, None, 5, 5]  # each 0.5 s
    rows = [
        ChildInstant(0.5 * k, number, 0.02, 2, "" if number else "assembly", 0, {1: 1, 2: 2, 3: 3})
        for k, number in enumerate(numbers)
    ]
    found = child_figures(rows)
    assert (found["lost_s"], found["longest_s"], found["kept"]) == (1.5, 1.0, True)
    assert found["losers"] == {"assembly": 3} and found["adults_kept"]
    row = {"seed": 3, "cameras": 5, "rate": 20.0, "lost_by": "assembly 3", **found}
    text = "\n".join(parsed("child", []).lines({"rows": [row], "good": 0}))
    assert "1.00  True     assembly 3" in text and "0 of 1 takes" in text
    with pytest.raises(UsageError, match="'usual', 'hard'"):
        parsed("child", ["--kind", "easy"])


def test_a_detector_that_finds_nobody_is_told_as_the_loser():
    take = child_take(2, HARD)
    assert child_figures(solved(take))["lost_s"] == 0.0
    found = child_figures(solved(unseen(take, *HIDDEN)))
    assert 0.3 < found["lost_s"] < 1.0 and max(found["losers"], key=found["losers"].get) == "detection"
