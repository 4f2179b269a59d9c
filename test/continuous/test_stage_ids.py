"""Ids at instants: designated subjects, bystanders, and people who return after a long absence."""

from dataclasses import replace

import numpy as np
import pytest
from free_cameras import START_NS, FreeCapture

from panoptic_ros.domain import SubjectSet
from panoptic_ros.errors import ConfigError
from panoptic_ros.graph.build import configure, make_stage

SECOND = 1_000_000_000
INNER, OUTER = 0, 1  # people; at time 0 they are at x = 0.6 m and 1.4 m


class Sizes(FreeCapture):
    """The outer person is smaller; a `visitor` of another size takes this place from a time on."""

    visitor = None

    def joints(self, time_s):
        bodies = super().joints(time_s)
        return (
            bodies
            * np.array([1.0, 0.9 if self.visitor is None or time_s < 3.0 else self.visitor])[:, None, None]
        )


class Visitor(Sizes):
    visitor = 0.75


def views_of(capture):
    return [item.views[0] for item in capture.sets]


def away(begin, end, who=OUTER):
    return lambda person, time: person != who or not begin < time < end


def play(items, forget_at=None, **values):
    """People found at each instant, {s: {id: person}}, and the notices; `values` are those of tracking."""
    config = configure({"continuous": {"active": True, "rate_hz": 10.0}, "tracking": values})["continuous"]
    stage = make_stage("continuous", config, CAPTURE.context)
    results = []
    for item in items:
        results.append(stage.step(item))
        stage.settle()
    results.append(stage.flush())
    found = {}
    for item in (item for result in results for item in result.outputs):
        time = 1e-9 * (item.stamp_ns - START_NS)
        truth = np.mean(CAPTURE.joints(time)[..., :2], axis=1)
        places = np.nanmean(item.positions[..., :2], axis=1)
        nearest = np.linalg.norm(places[:, None] - truth, axis=-1).argmin(axis=1) if len(places) else []
        found[round(time, 3)] = dict(zip(item.ids.tolist(), map(int, nearest)))
    return found, [notice for result in results for notice in result.notices]


CAPTURE = Sizes(seconds=2.0)
VIEWS = views_of(CAPTURE)


@pytest.mark.parametrize(("word", "who"), [("7=1.3 0.1 0.9", OUTER), ("7=0.7 0 0.9", INNER), ("7", INNER)])
def test_subjects_are_reported_alone_under_their_ids(word, who):
    found, notices = play(VIEWS, subjects=[word])
    assert all(people == {7: who} for time, people in found.items() if time > 0.5)
    assert [(n.code, n.values["id"]) for n in notices] == [("continuous.designated", 7)]


def test_bystanders_are_reported_under_other_ids_where_asked_for():
    found, _ = play(VIEWS, subjects=["0=1.3 0.1 0.9"], bystanders=True)
    assert all(people[0] == OUTER and len(people) == 2 for time, people in found.items() if time > 0.5)


def test_a_place_where_nobody_is_designates_nobody():
    found, notices = play(VIEWS, subjects=["7=4 4 0.9"])
    assert not any(found.values()) and notices == []


def test_subjects_are_said_anew():
    items = list(VIEWS)
    for time, subjects in (
        (1.5, SubjectSet.of_nobody()),
        (1.0, SubjectSet(0, [1, 0], tracks=[0, 1])),
        (0.5, SubjectSet(0, [1])),
    ):
        items.insert(round(time * 60), subjects)
    found, _ = play(items)
    assert found[0.3] == {0: INNER, 1: OUTER} and found[0.8] == {1: OUTER}
    assert found[1.3] == {1: INNER, 0: OUTER} == found[1.8]


def test_a_subject_is_recognised_after_any_absence_and_others_are_not_taken_for_it():
    for cls, last in ((Sizes, {7: OUTER}), (Visitor, {})):
        views = views_of(cls(seconds=6.0, there=away(1.0, 4.5)))
        found, notices = play(views, subjects=["7=1.3 0.1 0.9"])
        assert found[0.8] == {7: OUTER} and all(found[round(t, 1)] == {} for t in np.arange(1.6, 4.5, 0.1))
        assert found[5.8] == last and len(notices) == 1


def test_people_who_return_within_the_memory_keep_their_ids():
    views = views_of(Sizes(seconds=6.0, there=away(1.0, 4.5)))
    assert [play(views, memory=memory)[0][5.8] for memory in (2.0, 30.0)] == [
        {0: INNER, 2: OUTER},
        {0: INNER, 1: OUTER},
    ]
    visitor = views_of(Visitor(seconds=6.0, there=away(1.0, 4.5)))
    assert play(visitor, memory=30.0)[0][5.8] == {0: INNER, 2: OUTER}


def test_a_newcomer_who_may_be_a_lost_person_is_reported_when_that_is_decided():
    views = views_of(Visitor(seconds=6.0, there=away(1.0, 4.5)))
    for patience in (0.0, 0.6):
        found, _ = play(views, memory=30.0, recognition_time=patience)
        first = min(time for time, people in found.items() if time > 4.0 and len(people) == 2)
        assert first < 4.8 + patience


@pytest.mark.parametrize(("absence", "ids"), [(1.5, {0: INNER, 1: OUTER}), (61.5, {2: OUTER, 3: INNER})])
def test_people_keep_their_ids_over_a_short_restart_of_the_node(absence, ids):
    config = configure({"continuous": {"active": True, "rate_hz": 10.0}})["continuous"]
    stage, other = (make_stage("continuous", config, CAPTURE.context) for _ in range(2))
    views = views_of(Sizes(seconds=4.5))
    for view in views[:90]:  # 1.5 s
        stage.step(view)
        stage.settle()
    other.begin(stage.lasting_state())
    added_ns = round((absence - 1.5) * SECOND)
    moved = [replace(view, stamp_ns=view.stamp_ns + added_ns) for view in views[180:]]
    last = [item for view in moved for item in other.step(view).outputs][-1]
    truth = CAPTURE.joints(1e-9 * (last.stamp_ns - added_ns - START_NS))
    gaps = np.linalg.norm(truth[:, None] - last.positions[None], axis=-1).mean(axis=-1)
    assert dict(zip(last.ids.tolist(), gaps.argmin(axis=0).tolist())) == ids


def test_constant_biases_of_the_detector_are_in_the_covariances():
    skeleton = replace(CAPTURE.context.skeleton, bias_floors=(0.01,) * 19)
    config = configure({"continuous": {"active": True, "rate_hz": 10.0}})["continuous"]
    stages = [
        make_stage("continuous", config, context)
        for context in (CAPTURE.context, replace(CAPTURE.context, skeleton=skeleton))
    ]
    noise, whole = ([item for view in VIEWS[:60] for item in one.step(view).outputs][-1] for one in stages)
    assert len(noise.ids) == 2
    assert np.allclose(whole.covariances, noise.covariances + 1e-4 * np.eye(3))


def test_subjects_outlast_a_pause_and_a_restart():
    config = configure({"continuous": {"active": True, "rate_hz": 10.0}})["continuous"]
    stage, other = (make_stage("continuous", config, CAPTURE.context) for _ in range(2))
    for item in [*VIEWS[:60], SubjectSet(0, [1]), *VIEWS[60:]]:
        stage.step(item)
    other.begin(stage.lasting_state())
    later = [replace(view, stamp_ns=view.stamp_ns + 60 * SECOND) for view in VIEWS]
    for one in (other, stage):
        if one is stage:
            stage.forget()
        sets = [item for view in later for item in one.step(view).outputs]
        assert {number for item in sets for number in item.ids.tolist()} == {1}


def test_words_that_designate_nobody_are_named():
    with pytest.raises(ConfigError, match=r"subjects: 'anna' is not of the form"):
        play([], subjects=["anna"])
