"""Paired differences of figures with and without a mechanism, and their statistical significance."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import t as student

from panoptic_ros.study.ablation.figures import FIGURES
from panoptic_ros.study.study import CONFIDENCE

DEFAULT = ""  # name of the run with all mechanisms
EVERYTHING = "all scenes"
Samples = list[dict[str, Any]]  # figures by key, one mapping per seed or part of a recording


@dataclass(frozen=True)
class Difference:
    """Mean change of a figure.

    Args:
        mean: NaN if no pair has the figure.
        error: standard error of the mean; NaN for a single pair.
        freedom: degrees of freedom of the error; 0 for a single pair.
    """

    mean: float
    error: float
    freedom: float

    @property
    def clear(self) -> bool:
        """Return whether the change is significant (Student's t, 95 %)."""
        if not self.freedom > 0.0 or not self.error >= 0.0 or self.mean == 0.0:
            return False
        return abs(self.mean) > float(student.ppf(0.5 + 0.5 * CONFIDENCE, self.freedom)) * self.error


def paired(off: Sequence[float], default: Sequence[float]) -> Difference:
    """Return the mean of off - default over samples that have both values.

    A sample is a seed or a part of a recording.
    """
    changes = np.subtract(off, default)
    changes = changes[np.isfinite(changes)]
    count = len(changes)
    if count < 2:
        return Difference(float(changes[0]) if count else math.nan, math.nan, 0.0)
    return Difference(float(changes.mean()), float(changes.std(ddof=1) / math.sqrt(count)), count - 1.0)


def over_scenes(differences: Sequence[Difference]) -> Difference:
    """Return the mean over scenes with equal weights, regardless of the number of samples per scene.

    The degrees of freedom follow Welch and Satterthwaite.
    """
    known = [d for d in differences if math.isfinite(d.mean)]
    if not known:
        return Difference(math.nan, math.nan, 0.0)
    mean = sum(d.mean for d in known) / len(known)
    if any(not math.isfinite(d.error) for d in known):
        return Difference(mean, math.nan, 0.0)
    squares = [d.error**2 for d in known]
    spread = sum(square**2 / d.freedom for square, d in zip(squares, known))
    freedom = sum(squares) ** 2 / spread if spread else sum(d.freedom for d in known)
    return Difference(mean, math.sqrt(sum(squares)) / len(known), freedom)


def summary(rows: Sequence[Mapping[str, Any]], names: Sequence[str]) -> list[dict[str, Any]]:
    """Return the default figures and their changes without each mechanism, overall and per scene.

    Args:
        rows: figures of every sample, with its scene and `off`, the mechanism that was off; `DEFAULT` = none.
    """
    samples: dict[str, dict[str, Samples]] = {}
    for row in rows:
        samples.setdefault(row["scene"], {}).setdefault(row["off"], []).append(dict(row))
    differences = {
        scene: {name: _differences(runs[name], runs[DEFAULT]) for name in names if name in runs}
        for scene, runs in samples.items()
    }
    means = {scene: _means(runs[DEFAULT]) for scene, runs in samples.items()}
    everywhere = {
        name: {
            figure.key: over_scenes([own[name][figure.key] for own in differences.values() if name in own])
            for figure in FIGURES
        }
        for name in names
    }
    blocks = [(EVERYTHING, _means(list(means.values())), len(samples), everywhere)]
    blocks += [(scene, means[scene], len(samples[scene][DEFAULT]), own) for scene, own in differences.items()]
    return [
        {
            "scene": scene,
            "samples": count,
            "default": {key: _number(value) for key, value in mean.items()},
            "off": {
                name: {key: _row(found) for key, found in figures.items()} for name, figures in own.items()
            },
        }
        for scene, mean, count, own in blocks
    ]


def _differences(off: Samples, default: Samples) -> dict[str, Difference]:
    return {
        figure.key: paired([row[figure.key] for row in off], [row[figure.key] for row in default])
        for figure in FIGURES
    }


def _means(rows: Sequence[dict[str, float]]) -> dict[str, float]:
    return {figure.key: _mean(row[figure.key] for row in rows) for figure in FIGURES}


def _mean(values: Iterable[float]) -> float:
    known = [value for value in values if math.isfinite(value)]
    return sum(known) / len(known) if known else math.nan


def _row(found: Difference) -> dict[str, Any]:
    return {"mean": _number(found.mean), "error": _number(found.error), "clear": found.clear}


def _number(value: float) -> float | None:
    """Return the value, or None for JSON if it is not finite."""
    return value if math.isfinite(value) else None
