"""The study of identities: all of its figures."""
from __future__ import annotations

from typing import Any

from panoptic_ros.bench.dressed import dressed_visits
from panoptic_ros.bench.identity import NO_SETTINGS, VISITS_S, Settings, few_views, trials, visits
from panoptic_ros.stage import Progress, part_of, untold

TRIALS_PER_TAKE = 10  # of the other scenes, which are longer


def study_identity(
    count: int, seed: int, settings: Settings = NO_SETTINGS, progress: Progress = untold
) -> dict[str, Any]:
    """All figures: `count` trials of each kind, a tenth of it of few views, visits of 6 s for each trial, and
    of 3 s of people in clothes."""
    takes = max(1, count // TRIALS_PER_TAKE)
    found = {
        "study": "identity", "seed": seed,
        "trials": trials(count, seed, settings, part_of(progress, 0.0, 0.4)),
        "few_views": few_views(takes, seed, settings, part_of(progress, 0.4, 0.6)),
        "visits": visits(seed, settings, VISITS_S * count / 100),
    }  # fmt: skip
    progress(0.8, "visits in clothes")
    found["dressed"] = dressed_visits(seed, VISITS_S * count / 200, settings)
    progress(1.0, "visits in clothes")
    return found
