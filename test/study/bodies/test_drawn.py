"""Captures drawn at random: always the same of a number, and as their names say."""

import numpy as np
import pytest

from panoptic_ros.kinematics.session import instants_of
from panoptic_ros.study.bodies import captures as drawn


def test_conditions_are_those_of_the_number_and_vary():
    names = [str(drawn.draw(np.random.default_rng([seed, 41]))) for seed in range(40)]
    assert names == [str(drawn.draw(np.random.default_rng([seed, 41]))) for seed in range(40)]
    assert len(set(names)) > 35 and {"2+13", "8+0"} <= {name.split()[1] for name in names}


@pytest.mark.parametrize("seed", [1, 2])
def test_a_capture_is_as_its_name_says(monkeypatch, seed):
    monkeypatch.setattr(drawn, "SECONDS", 0.5)
    monkeypatch.setattr(drawn, "LEAVES_SECONDS", 0.5)
    case = drawn.drawn_case(seed)
    said = drawn.draw(np.random.default_rng([seed, 41]))
    assert case.name == str(said) and len(case.recording.views) == len(case.recording.rig) == said.cameras
    for series, rate in (
        *((view, said.camera_hz) for view in case.recording.views.values()),
        *((device, said.imu_hz) for device in case.recording.devices.values()),
    ):
        assert np.allclose(np.diff(series.stamps), 1e9 / rate, atol=2)
    assert len(case.recording.devices) == said.imus * len(case.subjects)
    assert all(subject.measured == said.lengths for subject in case.subjects)
    instants = instants_of(case.recording.views, {}, drawn.SOLVED)
    wanted, true = set(instants.tolist()), {state.stamp_ns for state in case.truth}
    assert len(wanted & true) >= len(wanted) - 1
