"""Trials of identities: simulated persons who are hidden, cross, come and go, or are seen by few views."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from panoptic_ros.domain import DetectionSet, ViewAppearance
from panoptic_ros.evaluation.ellipsoids import ELLIPSOID_95
from panoptic_ros.evaluation.pairing import match_people
from panoptic_ros.graph.build import configure, merged
from panoptic_ros.graph.nodes import FUSION
from panoptic_ros.graph.pipeline import Pipeline
from panoptic_ros.simulation import Absence, SimulatedScene, Simulation, simulate
from panoptic_ros.simulation.degradation import MILD
from panoptic_ros.simulation.rigs import Ring
from panoptic_ros.simulation.scenes import scene
from panoptic_ros.simulation.skeleton import SKELETON
from panoptic_ros.simulation.timing import Timing
from panoptic_ros.stage import Progress, StageContext, untold

Array = np.ndarray
Settings = Mapping[str, Mapping[str, Any]]
Looks = Callable[[Simulation, Sequence[DetectionSet]], Mapping[int, Sequence[ViewAppearance]]]
NO_SETTINGS: Settings = {}
SETTLED = 1.0  # s after an event, within which persons must have their ids again
VISITS_S, VISITORS, VISITS_HZ = 600.0, 5, 15.0
STAYS, AWAY = (15.0, 60.0), (3.0, 30.0)  # s, ranges of the time in and out of the room


class Match(NamedTuple):
    """A person who was found: the id, errors (J,) m, squared Mahalanobis distances (J,); NaN = no joint."""

    number: int
    errors: Array
    distances: Array


@dataclass(frozen=True)
class Instant:
    """Persons at one time step: those who are visible, and those who were found."""

    seconds: float
    there: frozenset[int]
    found: Mapping[int, Match]


def follow(
    what: SimulatedScene, seed: int, settings: Settings = NO_SETTINGS, looks: Looks | None = None
) -> list[Instant]:
    """Solve a take of a scene, and match its persons with the results.

    Args:
        looks: function that returns the clothing colours by index of the set; None = no appearance.
    """
    take = simulate(what, seed)
    results: list[Any] = []
    pipeline = Pipeline(
        configure(settings),
        StageContext(take.rig, SKELETON),
        FUSION,
        on_record=lambda topic, record: results.append(record) if topic == "skeletons" else None,
    )
    sets = list(take.detection_sets())
    seen = {} if looks is None else looks(take, sets)
    for number, item in enumerate(sets):
        for look in seen.get(number, ()):
            pipeline.push("appearance", look)
        pipeline.push("detection_sets", item)
    pipeline.flush()
    ticks = take.schedule.ticks
    truths = np.stack([person.joints(ticks) for person in take.people], axis=1)
    found = []
    for tick, truth, result in zip(ticks, truths, results, strict=True):
        people = [p for p in take.people if p.is_present(tick)]
        rows = [p.id for p in people]
        matches, _ = match_people(truth[rows], result.positions)
        there = frozenset(p.id for p in people if not take.is_ignored(p, tick))
        found.append(
            Instant(
                float(tick), there, {rows[t]: _match(result, r, truth[rows[t]]) for t, r in matches.tolist()}
            )
        )
    return found


def _match(result: Any, row: int, truth: Array) -> Match:
    gaps = result.positions[row] - truth
    there = np.isfinite(gaps[:, 0])
    distances = np.full(len(gaps), np.nan)
    inverse = np.linalg.inv(result.covariances[row][there])
    distances[there] = np.einsum("ji,jik,jk->j", gaps[there], inverse, gaps[there])
    return Match(int(result.ids[row]), np.linalg.norm(gaps, axis=-1), distances)


# ------------------------------------------------------------------ trials of events


def hidden_trial(seed: int) -> tuple[SimulatedScene, tuple[float, float]]:
    """Return a scene with a person who is invisible for one second, and this second."""
    base = scene("occluded")
    begin = 1.0 + 0.05 * (seed % 7)
    return replace(base, absences=(Absence(0, begin, begin + 1.0),), frames=105), (begin, begin + 1.0)


def crossing_trial(seed: int) -> tuple[SimulatedScene, tuple[float, float]]:
    """Return a scene with two persons who pass at half a metre, and the time in which they are near."""
    return replace(scene("crossing"), frames=90), (1.0, 2.0)


def pause_trial(seed: int) -> tuple[SimulatedScene, tuple[float, float]]:
    """Return a scene in which all persons are invisible for 0.3 to 1.3 s, and this time.

    After it, three of five cameras see them.
    """
    base = scene("noisy-8p5v")
    rng = np.random.default_rng([seed, 78])
    begin, end = 1.0, 1.0 + float(rng.uniform(0.3, 1.3))
    dead = tuple(sorted(rng.choice(5, 2, replace=False).tolist()))
    everybody = range(len(base.activities))
    pauses = tuple(Absence(k, begin, end) for k in everybody)
    fewer = tuple(Absence(k, end, 10.0, cameras=dead) for k in everybody)
    return replace(base, absences=pauses + fewer, frames=round(30.0 * (end + 1.2))), (begin, end)


def slow_trial(seed: int) -> tuple[SimulatedScene, tuple[float, float]]:
    """Return a scene of eight persons at 2 to 5 images/s.

    At this rate, single joints can hardly be predicted.
    """
    rate = float(np.random.default_rng([seed, 79]).uniform(2.0, 5.0))
    base = scene("noisy-8p5v")
    return replace(base, timing=replace(base.timing, rate=rate), frames=round(7.0 * rate)), (1.5, 5.5)


def stranger_trial(seed: int) -> tuple[SimulatedScene, tuple[float, float]]:
    """Return a scene in which a person leaves for good and another one comes, and the time between.

    The newcomer is the person nearest to the one who leaves, and appears for the first time 0.3 to 1.5 s
    later.
    """
    base, rng = scene("noisy-8p5v"), np.random.default_rng([seed, 80])
    begin, end = 1.0, 1.0 + float(rng.uniform(0.3, 1.5))
    then = np.array([begin])
    places = np.stack([person.joints(then)[0, :, :2].mean(axis=0) for person in simulate(base, seed).people])
    gone = int(rng.integers(len(places)))
    away = np.linalg.norm(places - places[gone], axis=-1)
    away[gone] = np.inf
    absences = Absence(gone, begin, 100.0), Absence(int(away.argmin()), 0.0, end)
    return replace(base, absences=absences, frames=round(30.0 * (end + 1.2 * SETTLED))), (begin, end)


def told_apart(instants: Sequence[Instant], event: tuple[float, float]) -> bool:
    """Return whether no person takes over the id of another one.

    The ids from before an event are compared with those from `SETTLED` after it.

    Args:
        event: (from, until), s.
    """
    owners = {m.number: p for now in instants if now.seconds < event[0] for p, m in now.found.items()}
    return all(
        owners.get(match.number, person) == person
        for now in instants
        if now.seconds >= event[1] + SETTLED
        for person, match in now.found.items()
    )


def kept_ids(instants: Sequence[Instant], event: tuple[float, float]) -> bool:
    """Return whether each person who was found before an event has the same id soon after it.

    Args:
        event: (from, until), s.
    """
    before: dict[int, int] = {}
    after: dict[int, Counter[int]] = {}
    for now in instants:
        for person, match in now.found.items():
            if now.seconds < event[0]:
                before[person] = match.number
            elif event[1] + 0.5 * SETTLED <= now.seconds <= event[1] + SETTLED:
                after.setdefault(person, Counter())[match.number] += 1
    return bool(before) and all(
        person in after and after[person].most_common(1)[0][0] == number for person, number in before.items()
    )


def trials(
    count: int, seed: int, settings: Settings = NO_SETTINGS, progress: Progress = untold
) -> dict[str, Any]:
    """Return the share of successful trials of each kind.

    In a successful trial, all persons keep their ids. If a different person arrives, no person
    may take over the id of another.
    """
    kinds = {
        "hidden for 1 s": (hidden_trial, kept_ids),
        "crossing at 0.5 m": (crossing_trial, kept_ids),
        "all after a pause": (pause_trial, kept_ids),
        "2 to 5 images/s": (slow_trial, kept_ids),
        "somebody else comes": (stranger_trial, told_apart),
    }
    kept: dict[str, int] = dict.fromkeys(kinds, 0)
    lost: dict[str, list[int]] = {kind: [] for kind in kinds}
    for k in range(count):
        for j, (kind, (make, is_good)) in enumerate(kinds.items()):
            progress((k * len(kinds) + j) / (count * len(kinds)), kind)
            what, event = make(seed + k)
            good = is_good(follow(what, seed + k, settings), event)
            kept[kind] += good
            if not good:
                lost[kind].append(seed + k)
    progress(1.0, "trials")
    return {"trials": count, "kept": {kind: kept[kind] / count for kind in kinds}, "lost": lost}


# ------------------------------------------------------------------ persons in few views


def few_views(
    count: int, seed: int, settings: Settings = NO_SETTINGS, progress: Progress = untold
) -> dict[str, Any]:
    """Return errors while two views, then one, see the upper half of a person; and a child among adults."""
    phases = {"two views": (3.0, 4.5), "one view": (4.5, 6.0)}
    errors: dict[str, list[Array]] = {name: [] for name in phases}
    inside: dict[str, list[Array]] = {name: [] for name in phases}
    present: dict[str, list[float]] = {name: [] for name in phases}
    lost, children = [], 0
    for k in range(count):
        progress(k / count, "few views")
        instants = follow(scene("walk-out-3p8v"), seed + k, settings)
        for name, (begin, end) in phases.items():
            for now in instants:
                if begin + 0.1 <= now.seconds < end:
                    match = now.found.get(0)
                    there = np.zeros(1, bool) if match is None else np.isfinite(match.errors)
                    present[name].append(float(there.mean()))
                    if match is not None:
                        errors[name].append(match.errors[there])
                        inside[name].append(match.distances[there] < ELLIPSOID_95)
        child = follow(scene("child-among-3p8v"), seed + k, settings)
        seconds = (child[-1].seconds - child[0].seconds) / (len(child) - 1)
        missed = [0 not in now.found for now in child if now.seconds > 1.0]
        lost.append(sum(missed) * seconds)
        numbers = {now.found[0].number for now in child if 0 in now.found and now.seconds > 1.0}
        children += len(numbers) == 1
    progress(1.0, "few views")
    rows = {}
    for name in phases:
        gaps = np.concatenate(errors[name]) if errors[name] else np.array([np.nan])
        hits = np.concatenate(inside[name]) if inside[name] else np.array([False])
        rows[name] = {
            "joints_given": float(np.mean(present[name])),
            "mean_mm": 1e3 * float(gaps.mean()),
            "p95_mm": 1e3 * float(np.quantile(gaps, 0.95)),
            "in_ellipsoid": float(hits.mean()),
        }
    return {
        "takes": count,
        "phases": rows,
        "child": {"lost_s": float(np.mean(lost)), "most_lost_s": max(lost), "kept": children / count},
    }


# ------------------------------------------------------------------ persons who come and go


def visits_scene(seed: int, seconds: float = VISITS_S) -> SimulatedScene:
    """Return a scene of five persons who walk about and leave now and then."""
    rng = np.random.default_rng([seed, 77])
    absences = []
    for person in range(VISITORS):
        now = rng.uniform(0.0, STAYS[1])
        while now < seconds:
            away = rng.uniform(*AWAY)
            absences.append(Absence(person, now, now + away))
            now += away + rng.uniform(*STAYS)
    return SimulatedScene(
        "five people who come and go",
        ("walk", "walk", "walk", "talk", "walk"),
        Ring(5),
        degradation=MILD,
        timing=Timing(rate=VISITS_HZ),
        absences=tuple(absences),
        frames=round(seconds * VISITS_HZ),
    )


def visit_figures(instants: Sequence[Instant]) -> dict[str, Any]:
    """Count the ids that persons who come and go keep, change or take over.

    A person in view has changed id if two successive finds without an absence in between differ. A return
    counts 1 s after the first find since the absence.
    """
    numbers: dict[int, int] = {}  # newest id of each person
    owners: dict[int, int] = {}  # first person with an id
    away: set[int] = set()
    pending: dict[int, float] = {}  # time (s) of the first find since the absence
    changes = returns = same = foreign = 0
    for now in instants:
        for person in list(numbers):
            if person not in now.there:
                away.add(person)
                pending.pop(person, None)
        for person, match in now.found.items():
            if person not in now.there:
                continue
            if person in away:
                pending.setdefault(person, now.seconds)
                if now.seconds - pending[person] < SETTLED:
                    continue
                away.discard(person)
                del pending[person]
                returns += 1
                same += match.number == numbers[person]
                foreign += owners.get(match.number, person) != person
            elif person in numbers and numbers[person] != match.number:
                changes += 1
            numbers[person] = match.number
            owners.setdefault(match.number, person)
    return {"changes": changes, "returns": returns, "same": same, "foreign": foreign}


def visits(seed: int, settings: Settings = NO_SETTINGS, seconds: float = VISITS_S) -> dict[str, Any]:
    """Return the id figures of five persons who come and go for ten minutes.

    The tracker remembers them for the longest absence.
    """
    settings = merged({"tracking": {"memory": AWAY[1]}}, settings)
    return {"seconds": seconds, **visit_figures(follow(visits_scene(seed, seconds), seed, settings))}
