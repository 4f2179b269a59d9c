"""What a budget chooses: as much as fits, people smaller before looks get rare, the same for all cameras."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from stage_cases import SECOND, known_people, watcher, watching_rig

from panoptic_ros.detection.budget import FEW, FEWEST, LEAST_HEIGHT, Budget, DetectionPace, Processor
from panoptic_ros.detection.config import DetectionConfig
from panoptic_ros.detection.stage import DetectionStage
from panoptic_ros.domain import ViewFrame
from panoptic_ros.errors import PanopticError


def run(share, look_s, rest_s, cameras=8, rate=25.0, seconds=12.0, every=1):
    """Cameras at a rate, of whose frames each `every`-th is taken; gives the budget and the cores it uses."""
    budget = Budget(share, 2, 220, DetectionPace(FEW, 220))
    credit, used = dict.fromkeys(range(cameras), 0.0), 0.0
    for number in range(0, int(seconds * rate), every):
        for camera in range(cameras):
            pace = budget.pace
            credit[camera] += every * (pace.looks_per_s or rate) / rate
            looked = credit[camera] >= 1.0
            credit[camera] -= looked
            cost = look_s * (pace.region_height / 220) ** 2 if looked else rest_s
            if number >= 0.7 * seconds * rate:
                used += cost / (0.3 * seconds)
            budget.took(str(camera), round(number / rate * SECOND), number, looked, cost)
    return budget, used


@given(
    share=st.floats(0.1, 1.0),
    look_ms=st.floats(5.0, 60.0),
    rest_ms=st.floats(0.2, 2.0),
    cameras=st.integers(2, 12),
)
def test_it_uses_what_is_allowed_and_no_more(share, look_ms, rest_ms, cameras):
    budget, used = run(share, 1e-3 * look_ms, 1e-3 * rest_ms, cameras)
    pace = budget.pace
    assert LEAST_HEIGHT <= pace.region_height <= 220
    assert pace.region_height == 220 or pace.looks_per_s <= FEW * 1.12
    if pace.looks_per_s == 0.0 or pace.looks_per_s > 1.12 * FEWEST:
        assert used <= 1.3 * share * 2
    if pace.looks_per_s and pace.region_height == 220:
        assert used >= 0.7 * share * 2
    assert budget.used() == pytest.approx(used, rel=0.35)


def test_cheap_images_are_all_looked_at():
    assert run(0.9, 0.002, 0.001)[0].pace == DetectionPace(0.0, 220)


def test_frames_that_nobody_took_count_as_frames_of_the_camera():
    assert run(0.3, 0.02, 0.001, every=2)[0].pace == pytest.approx(run(0.3, 0.02, 0.001)[0].pace, rel=0.15)


def images(stage, count):
    """A person in front of three cameras at 25 Hz; notices of the stage."""
    rng, told = np.random.default_rng(1), []
    picture = rng.integers(0, 255, (192, 256, 3), np.uint8)
    places = np.array([[[60.0, 60.0], [70.0, 100.0], [80.0, 140.0]]])
    for k in range(count):
        stamp = SECOND + k * 40_000_000
        stage.step(known_people(places, stamp, k))
        for name in watching_rig().names:
            told += stage.step(ViewFrame(name, stamp, k, picture)).notices
    return told


def test_live_the_stage_tells_what_it_chose():
    clock = iter(np.arange(0.0, 1e4, 0.02))
    context = watcher()
    context.extras["processor"] = Processor(2, lambda: float(next(clock)))
    config = DetectionConfig(budget=0.25, input_side=256, smallest_input=64, adapt_input=False)
    notices = images(DetectionStage(config, context), 40)
    told = [notice for notice in notices if notice.code == "detection.pace"]
    assert told and told[-1].severity == "info" and "of 2 cores, 0.50 allowed" in told[-1].text
    assert told[-1].values["looks_per_s"] < 25.0


def test_a_recording_is_looked_at_as_the_parameters_say():
    config = DetectionConfig(budget=0.25, input_side=256, smallest_input=64, adapt_input=False)
    assert not [n for n in images(DetectionStage(config, watcher()), 20) if n.code == "detection.pace"]


def test_shares_are_shares():
    with pytest.raises(PanopticError, match="budget"):
        DetectionConfig(budget=1.5)
