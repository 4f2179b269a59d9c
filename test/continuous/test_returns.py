"""Identities: the same as those of `/skeletons`, and honest about how well lengths are known."""

from collections import Counter

import numpy as np
import pytest

from panoptic_ros.continuous.bones import INTERVAL_S, PairDistances, learn_lengths
from panoptic_ros.continuous.config import ContinuousConfig
from panoptic_ros.continuous.passes import ContinuousPass
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.pipeline import records_of
from panoptic_ros.graph.recording import InMemoryRecording
from panoptic_ros.simulation import Absence, SimulatedScene, simulate
from panoptic_ros.simulation.degradation import MILD
from panoptic_ros.simulation.rigs import Ring
from panoptic_ros.simulation.skeleton import SKELETON
from panoptic_ros.simulation.timing import Timing
from panoptic_ros.stage import StageContext, untold

# the first returns in time to be re-identified, the second too late, the third is lost twice
ABSENCES = ((0, 2.0, 3.2), (1, 1.5, 5.0), (2, 2.5, 3.5), (2, 5.0, 6.5))


@pytest.mark.parametrize("seed", [1, 2])
def test_ids_of_people_who_leave_and_come_back_are_those_of_solve(seed):
    scene = SimulatedScene(
        "people who come and go",
        ("walk", "walk", "talk"),
        Ring(5),
        degradation=MILD,
        timing=Timing(rate=15.0),
        absences=tuple(Absence(*one) for one in ABSENCES),
        frames=120,
    )
    take = simulate(scene, seed)
    context, sets = StageContext(take.rig, SKELETON), list(take.detection_sets())
    solved = records_of("skeletons", sets, configure({}), context)
    recording = InMemoryRecording({"detection_sets": sets})
    motion = ContinuousPass(ContinuousConfig(), context).run(recording, untold)
    pairs = Counter()
    for one, other in zip(solved, motion.sets([item.stamp_ns for item in solved])):
        for number, body in zip(one.ids, one.positions):
            gaps = [np.nanmedian(np.linalg.norm(body - b, axis=1)) for b in other.positions]
            if min(gaps, default=np.inf) < 0.2:
                pairs[int(number), int(other.ids[np.argmin(gaps)])] += 1
    assert sorted(number for number, _ in pairs) == [0, 1, 2, 3]
    assert sorted(number for _, number in pairs) == [0, 1, 2, 3]
    assert sum(pairs.values()) > 0.97 * sum(len(item.ids) for item in solved)


def test_variances_of_lengths_are_those_of_their_errors():
    rng = np.random.default_rng(0)
    step = np.exp(-INTERVAL_S / 0.2)  # correlation of successive distances
    errors = []
    for _ in range(200):
        noise = rng.standard_normal((4, 500))
        for k in range(1, 500):
            noise[:, k] = step * noise[:, k - 1] + np.sqrt(1.0 - step**2) * noise[:, k]
        learnt = learn_lengths(PairDistances(0.4 + 0.01 * noise, np.full(noise.shape, 1e-4)))
        errors.append((learnt.lengths - 0.4) ** 2 / learnt.variances)
    assert 0.5 < np.mean(errors) < 2.0
