"""The study of identities: all of its figures."""

from __future__ import annotations

from typing import Any

from panoptic_ros.bench.designated import designated
from panoptic_ros.bench.dressed import dressed_visits
from panoptic_ros.bench.identity import NO_SETTINGS, VISITS_S, Settings, few_views, trials, visits
from panoptic_ros.stage import Progress, part_of, untold

TRIALS_PER_TAKE = 10  # of the other scenes, which are longer
DESIGNATED_S = 60.0  # of a take with a designated person; half as many as of the others


def study_identity(
    count: int, seed: int, settings: Settings = NO_SETTINGS, progress: Progress = untold
) -> dict[str, Any]:
    """All figures: `count` trials of each kind, a tenth of it of few views, visits of 6 s for each trial, of
    3 s of people in clothes, and of 3 s with a designated person."""
    takes = max(1, count // TRIALS_PER_TAKE)
    found = {
        "study": "identity",
        "seed": seed,
        "trials": trials(count, seed, settings, part_of(progress, 0.0, 0.4)),
        "few_views": few_views(takes, seed, settings, part_of(progress, 0.4, 0.6)),
        "visits": visits(seed, settings, VISITS_S * count / 100),
    }
    part = part_of(progress, 0.7, 0.8)
    found["designated"] = designated(max(1, takes // 2), seed, settings, DESIGNATED_S, part)
    progress(0.8, "visits in clothes")
    found["dressed"] = dressed_visits(seed, VISITS_S * count / 200, settings)
    progress(1.0, "visits in clothes")
    return found
