"""The study of identities."""

import numpy as np
from study_runs import run_named

from panoptic_ros.simulation import simulate
from panoptic_ros.study.names import parsed
from panoptic_ros.study.people import identity, identity_study
from panoptic_ros.study.people.identity import Instant, Match, kept_ids, told_apart, visit_figures
from panoptic_ros.study.people.identity_study import designated, designated_figures, dressed_scene, looks_of

NOWHERE = np.full(19, np.nan)
WAYS = ("bones", "appearance")


def instants(*rows):
    """One instant a second: {person: id}, who is there but not found: None."""
    found = [{p: Match(n, NOWHERE, NOWHERE) for p, n in row.items() if n is not None} for row in rows]
    return [Instant(float(k), frozenset(row), found[k]) for k, row in enumerate(rows)]


def test_returns_count_when_the_first_second_is_over_and_changes_at_once():
    found = visit_figures(
        instants(
            {0: 5, 1: 6},
            {0: 5, 1: 6},
            {1: 6},
            {0: 9, 1: 6},
            {0: 5, 1: 6},
            {0: 5, 1: 7},
            {0: 5},
            {0: 5, 1: None},
            {0: 5, 1: 5},
            {0: 5, 1: 5},
        )
    )
    assert found == {"changes": 1, "returns": 2, "same": 1, "foreign": 1}


def test_ids_are_kept_if_everybody_has_the_same_soon_after():
    before, gone = [{0: 1, 1: 2}] * 3, [{1: 2}] * 2
    assert kept_ids(instants(*before, *gone, *before), (3.0, 5.0))
    assert not kept_ids(instants(*before, *gone, *[{0: 2, 1: 1}] * 3), (3.0, 5.0))
    assert not kept_ids(instants(*before, *gone, *[{1: 2}] * 3), (3.0, 5.0))  # never found again


def test_somebody_else_must_not_have_the_id_of_who_has_gone():
    before = [{0: 1, 1: 2}] * 3
    assert told_apart(instants(*before, {1: 2}, {1: 2, 2: 1}, {1: 2, 2: 3}), (3.0, 4.0))
    assert not told_apart(instants(*before, {1: 2}, *[{1: 2, 2: 1}] * 2), (3.0, 4.0))


def test_the_study_runs_and_one_view_holds_somebody_who_was_seen_well(monkeypatch):
    monkeypatch.setattr(identity_study, "DESIGNATED_S", 4.0)
    monkeypatch.setattr(identity_study, "VISITS_S", 300.0)  # of which a trial takes a hundredth
    rows = run_named("identity", "--trials 1 --seeds 7")["rows"]
    assert [row["part"] for row in rows] == list(identity_study.PARTS)
    (found,) = (row for row in rows if row["part"] == "few views")
    one, two = found["phases"]["one view"], found["phases"]["two views"]
    assert two["mean_mm"] < 40.0 and one["mean_mm"] < 150.0 and one["joints_given"] > 0.4
    assert found["child"]["lost_s"] <= 0.2 and found["child"]["kept"] == 1.0
    dressed = {way: {"changes": 0, "returns": 7, "same": 6, "foreign": 1} for way in WAYS}
    parts = {
        "trials": {"trials": 1, "kept": {"hidden": 1.0}},
        "few views": found,
        "dressed": dressed,
        "visits": {"changes": 0, "returns": 3, "same": 2, "foreign": 0},
        "designated": {"there": 200, "followed": 199, "taken": 1},
    }
    rows = [{"part": part} | row for part, row in parts.items()]
    text = "\n".join(parsed("identity", []).lines({"rows": rows}))
    assert "2 of 3 returned under their own, 0 under somebody else's" in text and "one view" in text
    assert "followed in 99.5% of the instants that show the person; a bystander had the id in 1" in text
    assert "dressed, appearance  0 ids changed while there; 6 of 7 returned" in text


def test_a_designated_person_counts_while_there_and_bystanders_always():
    found = designated_figures(instants({0: 100, 1: 4}, {0: None}, {0: 7, 1: 100}, {1: 100}), 0)
    assert found == {"there": 3, "followed": 1, "taken": 2}


def test_a_designated_person_is_followed():
    found = designated(1, 5, seconds=8.0)
    assert found["followed"] > 0.9 * found["there"] > 0 and found["taken"] == 0


def test_visits_are_drawn_from_the_seed():
    one, again, other = (identity.visits_scene(seed, 60.0) for seed in (1, 1, 2))
    assert one == again != other and one.frames == 60 * identity.VISITS_HZ
    for absence in one.absences:
        assert identity.AWAY[0] <= absence.end - absence.start <= identity.AWAY[1]
    assert {a.person for a in one.absences} == set(range(identity.VISITORS))


def test_cameras_see_the_same_colours_of_somebody_from_all_sides():
    take = simulate(dressed_scene(3, 0.4), 3)
    looks = looks_of(take, list(take.detection_sets()))
    assert set(looks) == {0, 3}
    assert {look.camera for look in looks[0]} == set(take.rig.names)
    assert sum(np.isfinite(look.colours).any() for look in looks[0]) >= 4
