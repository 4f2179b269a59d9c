"""Inputs of which nothing can be used are named."""

from types import SimpleNamespace

import pytest

from panoptic_ros.errors import DataError
from panoptic_ros.nodes.stages import inputs as module
from panoptic_ros.running.runs.finish import TOLD


class Told:
    """A tally that keeps its notices."""

    def __init__(self):
        self.notices, self.refused = [], 0

    def refuse(self, stage, error):
        self.refused += 1

    def tell(self, stage, notice):
        self.notices.append(notice)


@pytest.fixture
def room(monkeypatch):
    """An entrance at a clock that the test sets, its tally, and inputs of two cameras."""
    clock = SimpleNamespace(now=0.0)
    monkeypatch.setattr(module.time, "monotonic", lambda: clock.now)
    monkeypatch.setattr(module, "check_record", lambda record, *rest: None)
    wiring = SimpleNamespace(
        specs=[SimpleNamespace(name="detection")], readers={"image": [SimpleNamespace(stage=0)]}
    )
    tally = Told()
    facts = SimpleNamespace(rig=None, skeleton=None)
    inputs = {
        name: SimpleNamespace(
            name=f"/{name}/image_raw",
            owner=name,
            topic="image",
            continuity=None,
            arrivals=SimpleNamespace(bad=0, title=f"{name} image"),
            record=lambda data: data,
            missing_before=lambda record: 0,
        )
        for name in ("left", "right")
    }
    return module.MessageValidator(facts, tally, {}, wiring), tally, clock, inputs


@pytest.mark.parametrize("rate", [0.5, 4.0, 30.0])
def test_a_camera_whose_images_are_all_refused_is_named_once_in_time(room, rate):
    door, tally, clock, inputs = room
    for k in range(int(10 * rate)):
        clock.now = k / rate
        door.refuse(inputs["left"], DataError("encoding bayer_x is not known"))
        assert door.record(inputs["right"], object()) is not None
        if tally.notices and k / rate - 1.0 / rate <= max(1.0, 2 / rate):
            break
    assert [note.code for note in tally.notices] == ["graph.unusable"]
    assert "left image" in tally.notices[0].text and "bayer_x" in tally.notices[0].text
    assert clock.now <= max(1.0, 3 / rate) + 1 / rate
    assert "graph.unusable" in TOLD
    for _ in range(int(10 * rate)):
        clock.now += 1 / rate
        door.refuse(inputs["left"], DataError("encoding bayer_x is not known"))
    assert len(tally.notices) == 1


def test_single_bad_images_are_counted_only(room):
    door, tally, clock, inputs = room
    for k in range(100):
        clock.now = k / 10
        door.refuse(inputs["left"], DataError("cut short"))
        if k % 3 == 0:
            door.record(inputs["left"], object())
    assert not tally.notices and tally.refused == 100 and inputs["left"].arrivals.bad == 100
