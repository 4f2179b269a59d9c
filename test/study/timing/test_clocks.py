"""Clocks and sync together, against the truth: mixed rates, and everything that clocks do."""

import numpy as np
import pytest

from panoptic_ros.study.timing.clocks import (
    WRONG_S,
    audio_error_s,
    events,
    mixed_world,
    recovery_s,
    run_world,
)

AT = 5
WORLDS = events(11.0, AT)
TOLD = {
    "nothing": {},
    "midnight": {},
    "0.1 s of audio lost": {},
    "clock forward 0.1 s": {"clocks.jump": 1},
    "clock forward 0.41 s": {"clocks.jump": 1},
    "clock back 0.41 s": {"clocks.jump": 1},
    "clock forward 1 h": {"clocks.jump": 1},
    "clock back 1 day": {"clocks.jump": 1},
    # after seconds of silence stamps are believed from the third on: sets do not wait for the two before
    "device stops and resumes": {"clocks.silent": 1, "sync.camera_silent": 1, "sync.late_frame": 2},
    "timecode jumps by 10 s": {"clocks.timecode_jump": 3},
    "timecode jumps by -2 s": {"clocks.timecode_jump": 3},
    "re-jam by 3 frames at midnight": {"clocks.timecode_jump": 3},
    "two devices swap": {"clocks.jump": 2},
}


@pytest.mark.parametrize("name", WORLDS)
def test_nothing_is_grouped_wrongly_whatever_clocks_do(name):
    outcome = run_world(WORLDS[name])
    errors = np.abs(outcome.errors_s)
    assert (errors > WRONG_S).sum() == 0 and errors.max() < 1e-4 and outcome.twice == 0
    assert len(errors) >= outcome.frames - 2
    codes = [n.code for n in outcome.notices if n.severity == "warning" or n.code == "clocks.timecode_jump"]
    assert {code: codes.count(code) for code in codes} == TOLD[name]
    if name != "device stops and resumes":
        assert recovery_s(outcome, AT) == 0.0
    late = [n for n in outcome.notices if n.code in ("sync.late_frame", "sync.no_clock")]
    assert len(late) <= 2


def test_sets_hold_what_belongs_together():
    outcome = run_world(mixed_world(10.0, seed=5))
    assert abs(outcome.sets - 299.7) < 3
    assert np.sqrt(np.mean(np.square(outcome.errors_s))) < 1e-6


def test_real_audio_through_the_decoder():
    for error in audio_error_s(6.0).values():
        assert error < 2e-6
