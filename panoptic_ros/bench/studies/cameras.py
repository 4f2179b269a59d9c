"""The study of the number of cameras."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import accumulate
from typing import Any

from panoptic_ros.bench.stage1.world import truth_of
from panoptic_ros.bench.studies.solving import score, solve
from panoptic_ros.domain import Rig
from panoptic_ros.evaluation import SkeletonSequence
from panoptic_ros.evaluation.studies import StudyScore
from panoptic_ros.graph.build import merged
from panoptic_ros.graph.recording import HeldRecording
from panoptic_ros.simulation import SKELETON, farthest_first, simulate
from panoptic_ros.simulation.studio import relative_noise, study_scene
from panoptic_ros.stage import Progress, Recording, StageContext, each, part_of

AREA = 1.6  # m
SETTINGS: dict[str, dict[str, Any]] = {
    "voting": {"method": "off"}, "association": {"temporal_guidance": False},
}  # fmt: skip
SIMULATED = 0.1  # share of the time that the simulation takes


@dataclass(frozen=True)
class CamerasStudyConfig:
    """What `CamerasStudy` needs to know.

    Args:
        counts: numbers of cameras, no more than the rig has.
        settings: parameters of voting and assembly.
    """

    counts: tuple[int, ...]
    settings: dict[str, dict[str, Any]] = field(default_factory=dict)


class CamerasStudy:
    """Scores of one recording (detection sets and truth) with fewer and fewer cameras: a `stage.Pass`."""

    def __init__(self, config: CamerasStudyConfig, context: StageContext):
        self._config, self._context = config, context

    def run(self, recording: Recording, progress: Progress) -> tuple[StudyScore, ...]:
        """One score for each number of cameras, each camera the farthest from those before it."""
        skeleton, counts = self._context.skeleton, self._config.counts
        settings = merged(SETTINGS, self._config.settings)
        truth = SkeletonSequence(skeleton.joint_names, tuple(recording.records("truth")))
        scores = []
        for count, told in zip(counts, shared_out(progress, counts)):
            sets = each(
                recording.records("detection_sets"), len(truth.frames), told, f"solving {count} cameras"
            )
            chosen = farthest_first(self._context.rig, count)
            scores.append(score(truth, solve(chosen, skeleton, sets, settings)))
        return tuple(scores)


def study_cameras(
    rig: Rig, people: Sequence[int], counts: Sequence[int], frames: int, seed: int, noise: float,
    settings: dict[str, dict[str, Any]], progress: Progress,
) -> dict[str, Any]:  # fmt: skip
    """Scores for every number of people and of cameras.

    Args:
        counts: numbers of cameras; those above the rig's are its own number.
        noise: of 2D joints, a share of the diagonal of a person's box.
        settings: parameters of voting and assembly.
    """
    config = CamerasStudyConfig(tuple(sorted({min(c, len(rig)) for c in counts}, reverse=True)), settings)
    rows = []
    for number, told in zip(people, shared_out(progress, people)):
        take = simulate(study_scene(rig, number, AREA, relative_noise(noise)), seed, frames)
        doing = f"{number} people: 2D people in {len(rig)} views"
        sets = list(each(take.detection_sets(), frames, part_of(told, 0.0, SIMULATED), doing))
        recording = HeldRecording({"detection_sets": sets, "truth": truth_of(take).frames})
        work = CamerasStudy(config, StageContext(take.rig, SKELETON))
        scores = work.run(recording, about(number, part_of(told, SIMULATED, 1.0)))
        rows += [
            {"people": number, "cameras": count, "kind": "given"} | found.to_mapping()
            for count, found in zip(config.counts, scores)
        ]
    return {"study": "cameras", "noise_share": noise, "frames": frames, "seed": seed, "rows": rows}


def shared_out(progress: Progress, costs: Sequence[float]) -> list[Progress]:
    """Progress of each of several parts, whose shares of the whole are as their costs."""
    ends = [sum_ / sum(costs) for sum_ in accumulate(costs)]
    return [part_of(progress, begin, end) for begin, end in zip([0.0, *ends], ends)]


def about(people: int, progress: Progress) -> Progress:
    """Progress that also says how many people are at hand."""
    return lambda share, doing: progress(share, f"{people} people: {doing}")
