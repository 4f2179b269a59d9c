"""Every stage hands over its state: a recording that is cut anywhere gives the same bytes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import captures
import pytest
from stage_cases import (
    MEMORY_TO_WORK_IN,
    NAMES,
    Case,
    answer,
    cases,
    content,
    end,
)

from panoptic_ros.domain import Rig
from panoptic_ros.errors import DataError
from panoptic_ros.graph.nodes import NODES
from panoptic_ros.stage import StageContext

# ---------------------------------------------------------------- what is promised


def test_every_stage_of_the_table_has_a_case():
    assert {case.name for case in cases().values()} == set(NODES) and set(cases()) == set(NAMES)
    assert all(case.name == name.split("-")[0] for name, case in cases().items())


@pytest.mark.parametrize("name", NAMES)
def test_a_recording_cut_anywhere_gives_the_same_bytes(name):
    """New stages, and one that was used for something else each time, go on from every position.

    Where they come to the state of the run without a cut they go on as it does, so few go on to the end.
    """
    case = cases()[name]
    new, used = case.stage(), case.stage()
    answers, states, last = uncut(case)
    assert len(set(map(repr, answers))) > 2
    for item in case.others:
        used.step(item)
    for k in range(len(states)):
        for stage, steps in ((new, 3 if k % 8 else len(answers)), (used, 3)):
            until = min(k + steps, len(answers))
            stage.begin(states[k])
            assert stage.state() == states[k]
            assert [answer(stage, item) for item in case.items[k:until]] == answers[k:until]
            assert stage.state() == states[until]
        if k % 8 == 0:
            assert end(new) == last


def uncut(case: Case) -> tuple[list[Any], list[bytes], Any]:
    """What every step gives, the state before the first and after each, and what the end gives."""
    stage = case.stage()
    answers, states = [], [stage.state()]
    for item in case.items:
        answers.append(answer(stage, item))
        states.append(stage.state())
        assert stage.state() == states[-1]
    return answers, states, end(stage)


@pytest.mark.parametrize("name", NAMES)
def test_the_state_is_all_that_steps_change(name):
    """Whatever differs between a used stage and a new one is in the layout; `begin` replaces all of it."""
    case = cases()[name]
    new, stage, used = case.stage(), case.stage(), case.stage()
    roots = {attribute.split(".")[0] for attribute in stage.LAYOUT.attributes}
    constant = [key for key in vars(stage) if key not in roots and (case.name, key) not in MEMORY_TO_WORK_IN]
    before = {key: content(vars(stage)[key], {}) for key in constant}
    for item in case.items[: len(case.items) * 2 // 3]:
        stage.step(item)
    for item in case.others:
        used.step(item)
    assert {key: content(vars(stage)[key], {}) for key in constant} == before
    for other in (new, used):
        assert not roots or content(stage.LAYOUT.values(other), {}) != content(stage.LAYOUT.values(stage), {})
        other.begin(stage.state())
        assert vars(other).keys() == vars(stage).keys()
        known = [key for key in vars(stage) if (case.name, key) not in MEMORY_TO_WORK_IN]
        found, wanted = ([vars(each)[key] for key in known] for each in (other, stage))
        assert content(found, {}) == content(wanted, {})
        assert {key: content(vars(other)[key], {}) for key in constant} == before


@pytest.mark.parametrize("name", NAMES)
def test_reset_gives_the_state_of_a_new_stage(name):
    case = cases()[name]
    stage = case.stage()
    new = stage.state()
    for item in case.items[: len(case.items) // 2]:
        stage.step(item)
    assert stage.state() != new or not stage.LAYOUT.attributes
    stage.reset()
    assert stage.state() == new


ANOTHER = {
    "kinematics": {"gate": 0.3},
    "timecode": {"agreeing_words": 5},
    "clocks": {"window_s": 3.0},
    "detection": {"input_side": 128},
    "health": {"memory_s": 30.0},
    "offsets": {"memory_s": 30.0},
    "continuous": {"lag": 0.2},
    "sync": {"queue_limit": 99},
    "voting": {"explain_away": False},
    "association": {"track_memory": 0.7},
    "assembly": {"noise_memory": 1000.0},
    "tracking": {"memory": 1.0},
    "refinement": {"process_noise": 3.0},
    "flow": {"width": 320},
    "patches": {"life": 5},
    "appearance": {"fewest": 3},
}


@pytest.mark.parametrize("name", [name for name in NAMES if name in NODES] + ["sync-live"])
def test_the_state_of_another_stage_configuration_or_rig_is_refused(name):
    case = cases()[name]
    stage = case.stage()
    for item in case.items[:5]:
        stage.step(item)
    state = stage.state()
    with pytest.raises(DataError, match=f"the state to begin {case.name} from is damaged"):
        stage.begin(state[: len(state) // 2])
    foreign = cases()["tracking" if name == "clocks" else "clocks"].stage().state()
    with pytest.raises(DataError, match=f"the state to begin {case.name} from is one of"):
        stage.begin(foreign)
    with pytest.raises(DataError, match="of a stage with different configuration"):
        case.stage(**ANOTHER[case.name]).begin(state)
    if "cameras" in stage.LAYOUT.same:
        first, *rest = captures.RIG.cameras
        context = StageContext(Rig((replace(first, name="another"), *rest)), captures.SKELETON)
        with pytest.raises(DataError, match="of a stage with different cameras"):
            case.stage(context).begin(state)
    assert stage.state() == state
