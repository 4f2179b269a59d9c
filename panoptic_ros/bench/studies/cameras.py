"""The study of the number of cameras."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from panoptic_ros.bench.stage1.world import truth_of
from panoptic_ros.bench.studies.solving import score, solve
from panoptic_ros.domain import Rig
from panoptic_ros.simulation import SKELETON, farthest_first, simulate
from panoptic_ros.simulation.studio import relative_noise, study_scene

AREA = 1.6  # m
SETTINGS: dict[str, dict[str, Any]] = {"voting": {"method": "off"}, "assembly": {"temporal_guidance": False}}


def study_cameras(
    rig: Rig, people: Sequence[int], counts: Sequence[int], frames: int, seed: int, noise: float,
    settings: dict[str, dict[str, Any]], tell: Callable[[str], None],
) -> dict[str, Any]:  # fmt: skip
    """Scores for every number of people and of cameras.

    Args:
        counts: numbers of cameras; those above the rig's are its own number.
        noise: of 2D joints, a share of the diagonal of a person's box.
        settings: parameters of voting and assembly.
        tell: is called with what is being done.
    """
    counts = sorted({min(count, len(rig)) for count in counts}, reverse=True)
    rows = []
    for number in people:
        take = simulate(study_scene(rig, number, AREA, relative_noise(noise)), seed, frames)
        tell(f"{number} people: 2D people in {len(rig)} views")
        sets, truth = list(take.detection_sets()), truth_of(take)
        for count in counts:
            tell(f"{number} people, {count} cameras")
            chosen = farthest_first(take.rig, count)
            found = score(truth, solve(chosen, SKELETON, sets, SETTINGS | settings))
            rows.append({"people": number, "cameras": count, "kind": "given"} | found.to_mapping())
    return {"study": "cameras", "noise_share": noise, "frames": frames, "seed": seed, "rows": rows}
