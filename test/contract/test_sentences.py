"""Texts stay plain: no room has more sentences that readers stumble over than it has reached."""

from pathlib import Path

import pytest
from sentences import faults, flagged

ROOT = Path(__file__).parents[2]
MOST = {
    "capture": 1,
    "detection": 1,
    "domain": 2,
    "export": 1,
    "io": 5,
    "kinematics": 5,
    "offsets": 1,
    "patches": 2,
    "refinement": 1,
    "running": 1,
    "state": 1,
    "study": 5,
    "sync": 1,
    "view": 1,
    "docs": 10,
}
ROOMS = sorted(path.name for path in (ROOT / "panoptic_ros").iterdir() if (path / "__init__.py").is_file())


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_stays_plain(room):
    assert flagged(list((ROOT / "panoptic_ros" / room).rglob("*.py"))) <= MOST.get(room, 0)


def test_documents_stay_plain():
    assert flagged([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]) <= MOST.get("docs", 0)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("How likely somebody who comes is somebody who left.", "summary"),
        ("By which process noise is multiplied.", "opening"),
        ("Clocks that nobody hears.", "word"),
        ("One " + "word " * 30 + "more.", "long"),
    ],
)
def test_a_riddle_is_found(text, fault):
    assert fault in faults(text, True)


def test_a_plain_sentence_passes():
    assert faults("Return the covariance (D, D) of the pose increment, given all measurements.", True) == []
