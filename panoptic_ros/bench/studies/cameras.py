"""The study of the number of cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from panoptic_ros.bench.stage1.world import truth_of
from panoptic_ros.bench.studies.solving import score, solve
from panoptic_ros.bench.studies.takes import Method, Takes, of_people, shared_out
from panoptic_ros.domain import Rig
from panoptic_ros.evaluation import SkeletonSequence
from panoptic_ros.evaluation.studies import StudyScore
from panoptic_ros.graph.recording import HeldRecording
from panoptic_ros.simulation import SKELETON, farthest_first, simulate
from panoptic_ros.simulation.studio import relative_noise, study_scene
from panoptic_ros.stage import Progress, Recording, StageContext, each, part_of

AREA = 1.6  # m
SIMULATED = 0.1  # share of the time that the simulation takes


@dataclass(frozen=True)
class CamerasStudyConfig:
    """What `CamerasStudy` needs to know.

    Args:
        counts: numbers of cameras, no more than the rig has.
        methods: every one of them with every number of cameras.
    """

    counts: tuple[int, ...]
    methods: tuple[Method, ...] = (Method(),)

    @property
    def cases(self) -> list[tuple[int, Method]]:
        """Numbers of cameras and methods, in the order of the scores."""
        return [(count, method) for count in self.counts for method in self.methods]


class CamerasStudy:
    """Scores of one recording (detection sets and truth) with fewer and fewer cameras: a `stage.Pass`."""

    def __init__(self, config: CamerasStudyConfig, context: StageContext):
        self._config, self._context = config, context

    def run(self, recording: Recording, progress: Progress) -> tuple[StudyScore, ...]:
        """A score for each of the configuration's `cases`, each camera the farthest from those before it."""
        skeleton, cases = self._context.skeleton, self._config.cases
        truth = SkeletonSequence(skeleton.joint_names, tuple(recording.records("truth")))
        scores = []
        for (count, method), told in zip(cases, shared_out(progress, [count for count, _ in cases])):
            doing = f"solving {count} cameras, {method.name}"
            sets = each(recording.records("detection_sets"), len(truth.frames), told, doing)
            chosen = farthest_first(self._context.rig, count)
            scores.append(score(truth, solve(method, chosen, skeleton, sets).skeletons))
        return tuple(scores)


def study_cameras(
    rig: Rig, takes: Takes, counts: Sequence[int], methods: Sequence[Method], progress: Progress
) -> dict[str, Any]:
    """Scores for every number of people and of cameras, and every method.

    Args:
        counts: numbers of cameras; those above the rig's are its own number.
    """
    own = tuple(sorted({min(count, len(rig)) for count in counts}, reverse=True))
    config = CamerasStudyConfig(own, tuple(methods))
    rows = []
    for number, told in zip(takes.people, shared_out(progress, takes.people)):
        take = simulate(study_scene(rig, number, AREA, relative_noise(takes.noise)), takes.seed, takes.frames)
        doing = f"{number} people: 2D people in {len(rig)} views"
        sets = list(each(take.detection_sets(), takes.frames, part_of(told, 0.0, SIMULATED), doing))
        recording = HeldRecording({"detection_sets": sets, "truth": truth_of(take).frames})
        work = CamerasStudy(config, StageContext(take.rig, SKELETON))
        scores = work.run(recording, of_people(number, part_of(told, SIMULATED, 1.0)))
        rows += [
            {"people": number, "cameras": count, "kind": "given", "method": method.name} | found.to_mapping()
            for (count, method), found in zip(config.cases, scores)
        ]
    return {
        "study": "cameras",
        "noise_share": takes.noise,
        "frames": takes.frames,
        "seed": takes.seed,
        "rows": rows,
    }
