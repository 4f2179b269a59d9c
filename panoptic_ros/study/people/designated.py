"""Whether somebody who is designated is ever lost to a bystander: one of five who come and go."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from panoptic_ros.graph.build import merged
from panoptic_ros.identity.subjects import subject_word
from panoptic_ros.simulation import simulate
from panoptic_ros.simulation.skeleton import SKELETON
from panoptic_ros.stage import Progress, untold
from panoptic_ros.study.people.identity import (
    AWAY,
    NO_SETTINGS,
    VISITS_S,
    Instant,
    Settings,
    follow,
    visits_scene,
)

SUBJECT = 100  # the id


def designated_figures(instants: Sequence[Instant], person: int) -> dict[str, int]:
    """How long the subject was there, was found, and how long a bystander had the id; in instants."""
    there = [now for now in instants if person in now.there]
    return {
        "there": len(there),
        "followed": sum(person in now.found and now.found[person].number == SUBJECT for now in there),
        "taken": sum(
            any(match.number == SUBJECT for other, match in now.found.items() if other != person)
            for now in instants
        ),
    }


def designated(
    takes: int,
    seed: int,
    settings: Settings = NO_SETTINGS,
    seconds: float = VISITS_S,
    progress: Progress = untold,
) -> dict[str, Any]:
    """`designated_figures` of several takes together; the subject is told by the place at the beginning."""
    total = {"there": 0, "followed": 0, "taken": 0}
    for k in range(takes):
        progress(k / takes, "a designated person")
        what = visits_scene(seed + k, seconds)
        take = simulate(what, seed + k)
        first = take.schedule.ticks[:1]
        person = next(own for own in take.people if own.is_present(first).all())
        place = person.joints(first)[0][SKELETON.joint("BodyCenter")]
        told = {"tracking": {"memory": AWAY[1], "subjects": (subject_word(SUBJECT, place),)}}
        found = designated_figures(follow(what, seed + k, merged(told, settings)), person.id)
        total = {name: total[name] + found[name] for name in total}
    progress(1.0, "a designated person")
    return {"takes": takes, "seconds": seconds, **total}
