"""Identities: the same as those of `/skeletons`, and honest about how well lengths are known."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.continuous.bones import CORRELATION_S, INTERVAL_S, PairDistances, learn_lengths
from panoptic_ros.continuous.config import ContinuousConfig
from panoptic_ros.continuous.passes import ContinuousPass
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.pipeline import Pipeline, records_of
from panoptic_ros.graph.recording import InMemoryRecording
from panoptic_ros.simulation import Absence, SimulatedScene, simulate
from panoptic_ros.simulation.degradation import MILD
from panoptic_ros.simulation.rigs import Ring
from panoptic_ros.simulation.skeleton import SKELETON
from panoptic_ros.simulation.timing import Timing
from panoptic_ros.stage import StageContext, untold

# the first returns in time to be re-identified, the second too late, the third is lost twice
ABSENCES = ((0, 2.0, 3.2), (1, 1.5, 5.0), (2, 2.5, 3.5), (2, 5.0, 6.5))


# person 2 returns in time to be re-identified; person 4 enters, leaves, and is new when it returns
VISITS = ((1, -1.0, 0.6), (2, 1.0, 1.6), (3, -1.0, 0.05), (4, -1.0, 1.0), (4, 1.8, 4.4))
SCENES = {
    "three who come and go": SimulatedScene(
        "people who come and go",
        ("walk", "walk", "talk"),
        Ring(5),
        degradation=MILD,
        timing=Timing(rate=15.0),
        absences=tuple(Absence(*one) for one in ABSENCES),
        frames=120,
    ),
    "five visitors": SimulatedScene(
        "visitors",
        ("walk", "walk", "talk", "reach", "turn"),
        Ring(5),
        degradation=MILD,
        timing=Timing(rate=25.0),
        absences=tuple(Absence(*one) for one in VISITS),
        frames=125,
    ),
}


def turned_round(sets):
    """Yield the same sets with cameras and rows in reversed order."""
    for item in sets:
        views = []
        for view in reversed(item.views):
            rows = {name: getattr(view, name)[::-1] for name in ("points", "scores", "person_scores")}
            views.append(replace(view, **rows))
        yield replace(item, views=tuple(views))


def whole_motion(context, sets, stamps):
    recording = InMemoryRecording({"detection_sets": sets})
    return list(ContinuousPass(ContinuousConfig(), context).run(recording, untold).sets(stamps))


def online_motion(context, sets, rate):
    told = {"continuous": {"active": True, "rate_hz": rate}}
    found = []
    pipeline = Pipeline(
        configure(told), context, ["continuous"], on_record=lambda _, item: found.append(item)
    )
    for item in sets:
        for view in item.views:
            pipeline.push("detections", view)
    pipeline.flush()
    return found


def id_pairs(solved, others):
    """Count the pairs of ids of people at one place in results with equal stamps."""
    pairs, by_stamp = Counter(), {item.stamp_ns: item for item in others}
    for one in solved:
        other = by_stamp.get(one.stamp_ns)
        for number, body in zip(one.ids, one.positions) if other is not None else ():
            gaps = [np.nanmedian(np.linalg.norm(body - b, axis=1)) for b in other.positions]
            if min(gaps, default=np.inf) < 0.2:
                pairs[int(number), int(other.ids[np.argmin(gaps)])] += 1
    return pairs


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("name", SCENES)
def test_ids_are_those_of_solve(name, seed):
    take = simulate(SCENES[name], seed)
    context, sets = StageContext(take.rig, SKELETON), list(take.detection_sets())
    solved = records_of("skeletons", sets, configure({}), context)
    numbers = sorted({int(number) for item in solved for number in item.ids})
    total = sum(len(item.ids) for item in solved)
    stamps = [item.stamp_ns for item in solved]
    for found in (
        whole_motion(context, sets, stamps),
        whole_motion(context, list(turned_round(sets)), stamps),
    ):
        pairs = id_pairs(solved, found)
        assert sorted(pairs) == [(number, number) for number in numbers]
        assert sum(pairs.values()) > 0.97 * total
    pairs = id_pairs(solved, online_motion(context, sets, SCENES[name].timing.rate))
    assert sorted(pairs) == [(number, number) for number in numbers]
    assert sum(pairs.values()) > 0.94 * total


def test_variances_of_lengths_are_those_of_their_errors():
    rng = np.random.default_rng(0)
    step = np.exp(-INTERVAL_S / CORRELATION_S)  # correlation of successive distances
    errors = []
    for _ in range(200):
        noise = rng.standard_normal((4, 500))
        for k in range(1, 500):
            noise[:, k] = step * noise[:, k - 1] + np.sqrt(1.0 - step**2) * noise[:, k]
        learnt = learn_lengths(PairDistances(0.4 + 0.01 * noise, np.full(noise.shape, 1e-4)))
        errors.append((learnt.lengths - 0.4) ** 2 / learnt.variances)
    assert 0.5 < np.mean(errors) < 2.0
